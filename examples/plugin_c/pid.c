/* A controller in C: PID with commands of thrust and body rates. README.md says how it is built and flown. */
#include "gerono.h"
#include <math.h>
#include <stdlib.h>

static const double G = 9.81;
typedef struct { double kp, kv, ki, kr, mass, integral[3]; } pid;

static void *create(const gerono_setup *setup, char *why_not, size_t size) {
    (void)why_not, (void)size;
    pid *self = calloc(1, sizeof *self);
    self->kp = gerono_parameter_or(setup, "kp", 16.0); /* 1/s^2 */
    self->kv = gerono_parameter_or(setup, "kv", 8.0);  /* 1/s */
    self->ki = gerono_parameter_or(setup, "ki", 8.0);  /* 1/s^3 */
    self->kr = gerono_parameter_or(setup, "kr", 20.0); /* 1/s */
    self->mass = gerono_parameter_or(setup, "mass", 0.2);
    return self;
}

static int step(void *memory, const gerono_now *now, const gerono_input *in, const gerono_output *out) {
    pid *self = memory;
    const gerono_vehicle_state *state = in[GERONO_CONTROLLER_IN_STATE].sample;
    const gerono_path_reference *path = in[GERONO_CONTROLLER_IN_REFERENCE].sample;
    gerono_control_command *command = out[GERONO_CONTROLLER_OUT_COMMAND].sample;
    gerono_control_telemetry *telemetry = out[GERONO_CONTROLLER_OUT_TELEMETRY].sample;
    if (telemetry) memcpy(telemetry->values, self->integral, sizeof self->integral);
    if (!command) return 0;
    command->mode = GERONO_CONTROL_COMMAND_MODE_FAILSAFE;
    if (!state || !path || !now->armed) return 0;
    const double *R = state->world_from_body, *v = state->velocity_body;
    double force[3], length = 0.0; /* m (g e3 - a): what T R e3 should be */
    for (int i = 0; i < 3; i++) {
        double e = state->position_world[i] - path->position_world[i], d1 = path->derivative1_world[i];
        double velocity = R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2];
        double ahead = path->derivative2_world[i] * path->gamma_dot * path->gamma_dot + d1 * path->gamma_ddot;
        self->integral[i] += e * 1e-9 * (double)now->elapsed_ns;
        double a = ahead - self->kp * e - self->kv * (velocity - d1 * path->gamma_dot) - self->ki * self->integral[i];
        force[i] = self->mass * ((i == 2 ? G : 0.0) - a), length += force[i] * force[i];
    }
    double body[3], yaw = atan2(R[3], R[0]) - path->yaw;
    for (int i = 0; i < 3; i++) body[i] = (R[i] * force[0] + R[3 + i] * force[1] + R[6 + i] * force[2]) / sqrt(length);
    *command = (gerono_control_command){.thrust = fmax(0.0, body[2] * sqrt(length)), .mode = GERONO_CONTROL_COMMAND_MODE_RATES,
        .rates_body = {-self->kr * body[1], self->kr * body[0], -2.0 * sin(yaw)}};
    return 0;
}

static size_t state_size(const void *self) { (void)self; return sizeof ((pid *)0)->integral; }
static void save(const void *self, void *to) { memcpy(to, ((const pid *)self)->integral, state_size(self)); }
static void restore(void *self, const void *from) { memcpy(((pid *)self)->integral, from, state_size(self)); }

static const char *const LAYOUTS[] = GERONO_CONTROLLER_LAYOUTS;
static const gerono_plugin PLUGIN = {GERONO_ABI, sizeof PLUGIN, "controller", LAYOUTS, sizeof LAYOUTS / sizeof *LAYOUTS,
    create, step, state_size, save, restore, free};
const gerono_plugin *gerono_plugin_v1(void) { return &PLUGIN; }
