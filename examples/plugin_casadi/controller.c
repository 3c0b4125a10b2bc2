/* A controller around a law that CasADi wrote as C. It has no state of its own. */
#include "gerono.h"
#include "law.h"
#include <stdlib.h>

typedef struct { double gains[4]; } controller;

static void *create(const gerono_setup *setup, char *why_not, size_t size) {
    (void)why_not, (void)size;
    controller *self = malloc(sizeof *self);
    self->gains[0] = gerono_parameter_or(setup, "kp", 16.0); /* 1/s^2 */
    self->gains[1] = gerono_parameter_or(setup, "kv", 8.0);  /* 1/s */
    self->gains[2] = gerono_parameter_or(setup, "kr", 20.0); /* 1/s */
    self->gains[3] = gerono_parameter_or(setup, "mass", 0.2);
    return self;
}

static int step(void *self, const gerono_now *now, const gerono_input *in, const gerono_output *out) {
    const gerono_vehicle_state *s = in[GERONO_CONTROLLER_IN_STATE].sample;
    const gerono_path_reference *r = in[GERONO_CONTROLLER_IN_REFERENCE].sample;
    gerono_control_command *command = out[GERONO_CONTROLLER_OUT_COMMAND].sample;
    if (!command) return 0;
    command->mode = GERONO_CONTROL_COMMAND_MODE_FAILSAFE;
    if (!s || !r || !now->armed) return 0;
    const double *inputs[law_SZ_ARG] = {s->position_world, s->world_from_body, s->velocity_body, &s->thrust,
        r->position_world, r->derivative1_world, r->derivative2_world, r->derivative3_world,
        (const double[2]){r->gamma_dot, r->gamma_ddot}, &r->yaw, ((controller *)self)->gains};
    double result[4], *results[law_SZ_RES] = {result}, work[law_SZ_W + 1];
    int integers[law_SZ_IW + 1];
    if (law(inputs, results, integers, work, 0)) return 1;
    command->thrust = result[0];
    memcpy(command->rates_body, result + 1, sizeof command->rates_body);
    command->mode = GERONO_CONTROL_COMMAND_MODE_RATES;
    return 0;
}

static size_t state_size(const void *self) { (void)self; return 0; }
static void save(const void *self, void *to) { (void)self, (void)to; }
static void restore(void *self, const void *from) { (void)self, (void)from; }

static const char *const LAYOUTS[] = GERONO_CONTROLLER_LAYOUTS;
static const gerono_plugin PLUGIN = {GERONO_ABI, sizeof PLUGIN, "controller", LAYOUTS, sizeof LAYOUTS / sizeof *LAYOUTS,
    create, step, state_size, save, restore, free};
const gerono_plugin *gerono_plugin_v1(void) { return &PLUGIN; }
