/* An estimator that shows which of its inputs it gets: the thrust of the state is that of the last frame, or -1 before one. */
#include "gerono.h"
#include <stdlib.h>

static void *create(const gerono_setup *setup, char *why_not, size_t size) { (void)setup, (void)why_not, (void)size; return malloc(1); }

static int step(void *self, const gerono_now *now, const gerono_input *in, const gerono_output *out) {
    (void)self, (void)now;
    const gerono_mocap_pose *pose = in[GERONO_ESTIMATOR_IN_POSE].sample;
    const gerono_rc_frame *frame = in[GERONO_ESTIMATOR_IN_FRAME].sample;
    gerono_vehicle_state *state = out[GERONO_ESTIMATOR_OUT_STATE].sample;
    if (!state) return 0;
    state->thrust = frame ? frame->thrust : -1.0;
    if (!pose) return 0;
    state->tracked = pose->tracked;
    memcpy(state->position_world, pose->position_world, sizeof state->position_world);
    memcpy(state->world_from_body, pose->world_from_body, sizeof state->world_from_body);
    memcpy(state->velocity_body, pose->velocity_body, sizeof state->velocity_body);
    memcpy(state->angular_velocity_body, pose->angular_velocity_body, sizeof state->angular_velocity_body);
    return 0;
}

static size_t state_size(const void *self) { (void)self; return 0; }
static void save(const void *self, void *to) { (void)self, (void)to; }
static void restore(void *self, const void *from) { (void)self, (void)from; }

static const char *const LAYOUTS[] = GERONO_ESTIMATOR_LAYOUTS;
static const gerono_plugin PLUGIN = {GERONO_ABI, sizeof PLUGIN, "estimator", LAYOUTS, sizeof LAYOUTS / sizeof *LAYOUTS,
    create, step, state_size, save, restore, free};
const gerono_plugin *gerono_plugin_v1(void) { return &PLUGIN; }
