/* The law `geometric_pid` again, by its formulas (nominal.rs, geometric_pid.rs, yaw.rs) and with gains as parameters: it
 * must send the same frames as the built-in one, to the bit. geometric_pid.py and geometric_pid.rs are the same. */
#include "gerono.h"
#include <math.h>
#include <stdlib.h>

static const double G = 9.81, PI = 3.14159265358979323846;
typedef struct { double integral[3], omega[2], yaw_integral; } memory;
typedef struct {
    double kp, kv, ki, kr, limit, mass, step, yaw_kp, yaw_ki, yaw_limit;
    const gerono_math *math;
    memory memory;
} law;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static double clamp(double x, double limit) { return fmin(fmax(x, -limit), limit); }
static void cross(const double *a, const double *b, double *to) {
    for (int i = 0; i < 3; i++) to[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void *create(const gerono_setup *setup, char *why_not, size_t size) {
    (void)why_not, (void)size;
    law *self = calloc(1, sizeof *self);
    const struct { const char *name; double *place, otherwise; } numbers[] = {
        {"kp", &self->kp, 36.0}, {"kv", &self->kv, 12.0}, {"ki", &self->ki, 18.0}, {"kr", &self->kr, 39.24},
        {"limit", &self->limit, 9.0}, {"mass", &self->mass, 0.2}, {"step", &self->step, 0.001},
        {"yaw_kp", &self->yaw_kp, 4.0}, {"yaw_ki", &self->yaw_ki, 0.5}, {"yaw_limit", &self->yaw_limit, 0.5}};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        *numbers[i].place = gerono_parameter_or(setup, numbers[i].name, numbers[i].otherwise);
    self->math = setup->math;
    return self;
}

static int step(void *service, const gerono_now *now, const gerono_input *in, const gerono_output *out) {
    law *self = service;
    memory *m = &self->memory;
    const gerono_vehicle_state *state = in[GERONO_CONTROLLER_IN_STATE].sample;
    const gerono_path_reference *path = in[GERONO_CONTROLLER_IN_REFERENCE].sample;
    gerono_control_command *command = out[GERONO_CONTROLLER_OUT_COMMAND].sample;
    if (!command || !state || !path) return 0;
    const double elapsed = now->elapsed_ns ? (double)now->elapsed_ns / 1e9 : self->step;
    const double *R = state->world_from_body, *v = state->velocity_body, rate = path->gamma_dot, turn = path->gamma_ddot;
    const double *d1 = path->derivative1_world, *d2 = path->derivative2_world, *d3 = path->derivative3_world;
    double n[3], e[3], de[3], ahead[3], f[3], df[3];
    for (int i = 0; i < 3; i++) {
        n[i] = R[3 * i + 2];
        e[i] = state->position_world[i] - path->position_world[i];
        de[i] = R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2] - d1[i] * rate;
        ahead[i] = d2[i] * (rate * rate) + d1[i] * turn;
        m->integral[i] = clamp(m->integral[i] + (de[i] + e[i] * (2.0 * self->kp / self->kv)) * (self->ki * elapsed), self->limit);
        f[i] = (i == 2 ? G : 0.0) - (ahead[i] - self->kv * de[i] - self->kp * e[i]) + m->integral[i];
    }
    const double thrust = self->mass * dot(n, f);
    for (int i = 0; i < 3; i++) {
        const double jerk = d3[i] * (rate * rate * rate) + d2[i] * (3.0 * rate * turn) + d1[i] * path->gamma_dddot_constant;
        const double acceleration = (i == 2 ? G : 0.0) - n[i] * (thrust / self->mass);
        df[i] = -jerk + self->kv * (acceleration - ahead[i]) + self->kp * de[i];
    }
    if (f[2] < 0.3 * G) f[2] = 0.3 * G, df[2] = 0.0;
    double nd[3], dnd[3], across[3], along[3], omega[3];
    const double size = sqrt(dot(f, f));
    for (int i = 0; i < 3; i++) nd[i] = f[i] / size;
    const double radial = dot(nd, df);
    for (int i = 0; i < 3; i++) dnd[i] = (df[i] - nd[i] * radial) / size;
    cross(n, nd, across), cross(nd, dnd, along);
    const double sine = sqrt(dot(across, across)), angle = self->math->atan2(sine, dot(n, nd));
    for (int i = 0; i < 3; i++) omega[i] = (sine > 0.0 ? across[i] * (angle / sine) : 0.0) * self->kr + along[i];
    for (int i = 0; i < 2; i++) {
        const double column[3] = {R[i], R[3 + i], R[6 + i]}, end = dot(column, omega);
        command->rates_body[i] = 0.0 + (m->omega[i] + end) * 0.5; /* the mean over the hold */
        m->omega[i] = end;
    }
    double yaw = self->math->atan2(R[3], R[0]) - path->yaw;
    yaw -= 2.0 * PI * rint(yaw / (2.0 * PI));
    const double proportional = self->yaw_kp * yaw;
    command->rates_body[2] = 0.0 + (-proportional - m->yaw_integral); /* no negative zero */
    if (fabs(proportional) <= self->yaw_limit) m->yaw_integral += self->yaw_ki * yaw * elapsed;
    m->yaw_integral = clamp(m->yaw_integral, self->yaw_limit);
    command->thrust = thrust, command->mode = GERONO_CONTROL_COMMAND_MODE_RATES;
    return 0;
}

static size_t state_size(const void *self) { (void)self; return sizeof(memory); }
static void save(const void *self, void *to) { memcpy(to, &((const law *)self)->memory, sizeof(memory)); }
static void restore(void *self, const void *from) { memcpy(&((law *)self)->memory, from, sizeof(memory)); }

static const char *const LAYOUTS[] = GERONO_CONTROLLER_LAYOUTS;
static const gerono_plugin PLUGIN = {GERONO_ABI, sizeof PLUGIN, "controller", LAYOUTS, sizeof LAYOUTS / sizeof *LAYOUTS,
    create, step, state_size, save, restore, free};
const gerono_plugin *gerono_plugin_v1(void) { return &PLUGIN; }
