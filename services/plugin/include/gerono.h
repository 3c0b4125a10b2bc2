/* gerono.h: a service of Gerono from a shared library, in C or C++. Made by `gerono header`.
 *
 * The library exports gerono_plugin_v1. A service has no clock, does no input or output, and does not allocate in a
 * step; its state is all on which the next step depends besides its inputs. SI units and radians. The frame {I} has its
 * third axis down, and {B} its third axis opposite to the thrust. docs/plugins.md explains the rest.
 */
#ifndef GERONO_H
#define GERONO_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
#define GERONO_ASSERT(condition, text) static_assert(condition, text)
extern "C" {
#else
#define GERONO_ASSERT(condition, text) _Static_assert(condition, text)
#endif

#define GERONO_ABI 1

/* Time of a step, with the operator's requests. */
typedef struct {
    uint64_t tick;       /* base tick since the start of the flight */
    uint64_t time_ns;    /* time of the tick since the start of the flight, ns */
    uint64_t elapsed_ns; /* time since this service's previous step, ns; 0 at its first */
    uint8_t armed;       /* not 0 if the motors may turn */
    uint8_t land;        /* not 0 if the vehicle must land */
    uint8_t killed;      /* not 0 if the motors stop for ever */
    uint8_t arm_count;   /* number of requests to arm so far, modulo 32 */
    uint8_t pad[4];
} gerono_now;

/* The newest sample of an input. */
typedef struct {
    const void *sample; /* NULL before the first */
    uint64_t fresh;     /* not 0 if it was delivered since this service's previous step */
} gerono_input;

/* The place for a sample of an output. */
typedef struct {
    void *sample; /* zero but for its header; NULL if no sample is due */
} gerono_output;

/* A number of the scenario's table plugins.parameters. */
typedef struct {
    const char *name;
    double value;
} gerono_parameter;

/* Functions with the same results on every machine; those of a C library may differ in the last bit. */
typedef struct {
    double (*acos)(double), (*asin)(double), (*atan)(double), (*cbrt)(double), (*cos)(double), (*cosh)(double),
        (*exp)(double), (*expm1)(double), (*log)(double), (*log10)(double), (*log1p)(double), (*sin)(double),
        (*sinh)(double), (*tan)(double), (*tanh)(double);
    double (*atan2)(double, double), (*hypot)(double, double), (*pow)(double, double);
} gerono_math;

/* What a service may know when it is made. */
typedef struct {
    const char *scenario;               /* the scenario as JSON */
    const gerono_parameter *parameters; /* sorted by name */
    size_t parameter_count;
    uint8_t *asked; /* marks of gerono_parameter_or; a parameter that no library asks for is refused */
    const gerono_math *math;
} gerono_setup;

/* A service. */
typedef struct {
    uint32_t abi;               /* GERONO_ABI */
    uint32_t size;              /* sizeof(gerono_plugin) */
    const char *service;        /* such as "controller" */
    const char *const *layouts; /* such as GERONO_CONTROLLER_LAYOUTS */
    size_t layout_count;
    /* Makes a service. NULL if it cannot fly this scenario, with the reason as a text of at most `size` bytes. */
    void *(*create)(const gerono_setup *setup, char *why_not, size_t size);
    /* Writes the samples that are due. 0 if all is well. */
    int (*step)(void *self, const gerono_now *now, const gerono_input *in, const gerono_output *out);
    /* The size of the state, bytes; the same at all times. 0 if there is none. */
    size_t (*state_size)(const void *self);
    /* Writes the state after the last step. */
    void (*save)(const void *self, void *to);
    /* Continues from a saved state as if nothing had happened. */
    void (*restore)(void *self, const void *from);
    /* Frees the service. */
    void (*destroy)(void *self);
} gerono_plugin;

/* The function that the library exports. */
__attribute__((visibility("default"))) const gerono_plugin *gerono_plugin_v1(void);

/* Returns a parameter of the scenario, or `otherwise` if it is not there. */
static inline double gerono_parameter_or(const gerono_setup *setup, const char *name, double otherwise) {
    setup->asked[setup->parameter_count] = 1;
    for (size_t i = 0; i < setup->parameter_count; i++) {
        if (strcmp(setup->parameters[i].name, name) == 0) {
            setup->asked[i] = 1;
            return setup->parameters[i].value;
        }
    }
    return otherwise;
}

/* Generated: the samples of the topics, and the inputs and outputs of the services. */

typedef struct {
    uint64_t tick;                      /* Base tick at which the sample was published. */
    uint64_t stamp_ns;                  /* Time of that tick since the start of the flight, ns. */
    uint64_t seq;                       /* Number of the sample on its topic, from 0; in lock-step a function of the schedule. */
} gerono_header;
/* A sample of `vehicle/truth`. */
typedef struct {
    gerono_header header;               /* Common header. */
    double position_world[3];           /* p, position in {I}, m. */
    double world_from_body[9];          /* R, body to inertial, row-major. */
    double velocity_body[3];            /* v, linear velocity in {B}, m/s. */
    double angular_velocity_body[3];    /* ω, angular velocity in {B}, rad/s. */
    double thrust;                      /* T, thrust that acted up to this tick, N. */
    double torque_body[3];              /* τ, torque that acted up to this tick, in {B}, N m. */
    double mass;                        /* m, mass from this tick on, kg. */
    double inertia[3];                  /* Diagonal of J from this tick on, kg m². */
    double disturbance_world[3];        /* b, disturbance from this tick on, an acceleration in {I}, m/s²: the constant one, fan, turbulence and drag together. */
} gerono_vehicle_truth;
GERONO_ASSERT(sizeof(gerono_vehicle_truth) == 256, "another layout of gerono_vehicle_truth");
#define GERONO_VEHICLE_TRUTH_LAYOUT "ed8388ebbe7bd0f66aa2ee9a255d98c5"

/* A sample of `mocap/pose`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t capture_time_ns;           /* Time of the exposure, ns since the start of the flight. */
    double position_world[3];           /* Position of the body in {I}, m. */
    double world_from_body[9];          /* Attitude, body to inertial, row-major. */
    double velocity_body[3];            /* Linear velocity in {B}, m/s; only with `velocities_measured`. */
    double angular_velocity_body[3];    /* Angular velocity in {B}, rad/s; only with `velocities_measured`. */
    uint8_t tracked;                    /* `true` if the body was tracked; if not, all else is zero. */
    uint8_t velocities_measured;        /* `true` if the velocities are measured (ideal cameras); if not, they are zero. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_mocap_pose;
GERONO_ASSERT(sizeof(gerono_mocap_pose) == 184, "another layout of gerono_mocap_pose");
#define GERONO_MOCAP_POSE_LAYOUT "bedf9211a16ebf957d79fe1164763f9a"

/* A sample of `vehicle/state`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t state_time_ns;             /* Time of the state, ns since the start of the flight. */
    double position_world[3];           /* p, position in {I}, m. */
    double world_from_body[9];          /* R, body to inertial, row-major. */
    double velocity_body[3];            /* v, linear velocity in {B}, m/s. */
    double angular_velocity_body[3];    /* ω, angular velocity in {B}, rad/s. */
    double acceleration_world[3];       /* p̈, acceleration of the position in {I} at that time, m/s², which is 0 in hover; always 0 without a filter. */
    double thrust;                      /* T, thrust that acts at that time by the frames sent so far, N; 0 without a filter. */
    double position_sigma;              /* Standard deviation of the position, the largest axis, m. */
    uint32_t captures_refused;          /* Captures refused as outliers since the start of the flight. */
    uint8_t tracked;                    /* `true` if the state is based on a measurement of the body that is recent enough. */
    uint8_t coasting;                   /* `true` if due captures are missing, so that the state is predicted further than usual. */
    uint8_t pad0[2];                    /* Explicit padding. */
} gerono_vehicle_state;
GERONO_ASSERT(sizeof(gerono_vehicle_state) == 224, "another layout of gerono_vehicle_state");
#define GERONO_VEHICLE_STATE_LAYOUT "6590b045e30f1356f304c7efbe1e71af"

/* A sample of `path/reference`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t reference_time_ns;         /* Time of the reference, ns since the start of the flight: that of the state it was made from, and later by the excess of that state's age over its usual age. */
    double gamma;                       /* γ, path parameter. */
    double gamma_dot;                   /* γ̇, 1/s. */
    double gamma_ddot;                  /* γ̈ of the timing law (25), 1/s². */
    double gamma_dot_desired;           /* γ̇d = vd ψ(‖z1‖), 1/s. */
    double gamma_dddot_constant;        /* Constant part of γ⃛ = c0 + c1 d²‖z1‖/dt², 1/s³. */
    double gamma_dddot_slope;           /* Coefficient c1 of d²‖z1‖/dt² in γ⃛, 1/(m s). */
    double position_world[3];           /* pd(γ) in {I}, m. */
    double derivative1_world[3];        /* dpd/dγ in {I}, m. */
    double derivative2_world[3];        /* d²pd/dγ² in {I}, m. */
    double derivative3_world[3];        /* d³pd/dγ³ in {I}, m. */
    double yaw;                         /* ψd, desired yaw, rad. */
    double yaw_rate;                    /* Rate of the desired yaw, rad/s. */
    uint32_t states_refused;            /* Impossible states refused since the start of the flight. */
    uint8_t vehicle_known;              /* `true` if the position of the vehicle is known; if not, the path stands still. */
    uint8_t phase;                      /* Phase of the flight; a flight without phases is in the phase `fly` from its start. */
    uint8_t airborne;                   /* `true` if the vehicle is airborne, as far as its motion shows. */
    uint8_t cause;                      /* Cause of the phase. The causes of the envelope are added to the exceeded limit (`limit` of the frame). */
} gerono_path_reference;
#define GERONO_PATH_REFERENCE_PHASE_DISARMED 0
#define GERONO_PATH_REFERENCE_PHASE_ARMED 1
#define GERONO_PATH_REFERENCE_PHASE_TAKE_OFF 2
#define GERONO_PATH_REFERENCE_PHASE_FLY 3
#define GERONO_PATH_REFERENCE_PHASE_LAND 4
#define GERONO_PATH_REFERENCE_CAUSE_NONE 0
#define GERONO_PATH_REFERENCE_CAUSE_OPERATOR_KILLS 1
#define GERONO_PATH_REFERENCE_CAUSE_OPERATOR_DISARMS 2
#define GERONO_PATH_REFERENCE_CAUSE_OPERATOR_LANDS 3
#define GERONO_PATH_REFERENCE_CAUSE_NOT_READY 4
#define GERONO_PATH_REFERENCE_CAUSE_OVERDUE 5
#define GERONO_PATH_REFERENCE_CAUSE_TOUCHED_DOWN 6
#define GERONO_PATH_REFERENCE_CAUSE_FOUND_FLYING 7
#define GERONO_PATH_REFERENCE_CAUSE_STRAYED 8
#define GERONO_PATH_REFERENCE_CAUSE_ENVELOPE_LANDS 16
#define GERONO_PATH_REFERENCE_CAUSE_ENVELOPE_KILLS 32
GERONO_ASSERT(sizeof(gerono_path_reference) == 200, "another layout of gerono_path_reference");
#define GERONO_PATH_REFERENCE_LAYOUT "8807e0b528ab460a1d075197ae39727c"

/* A sample of `control/command`. */
typedef struct {
    gerono_header header;               /* Common header. */
    double thrust;                      /* T, thrust along −R e3, N. */
    double torque_body[3];              /* τ, torque in {B}, N m; with `MODE_TORQUE`. */
    double rates_body[3];               /* Body rates in {B}, rad/s; with `MODE_RATES`. */
    uint32_t mode;                      /* Quantities that the vehicle shall follow; none in failsafe. */
    uint32_t pad0;                      /* Explicit padding. */
} gerono_control_command;
#define GERONO_CONTROL_COMMAND_MODE_TORQUE 0
#define GERONO_CONTROL_COMMAND_MODE_RATES 1
#define GERONO_CONTROL_COMMAND_MODE_FAILSAFE 2
GERONO_ASSERT(sizeof(gerono_control_command) == 88, "another layout of gerono_control_command");
#define GERONO_CONTROL_COMMAND_LAYOUT "7725fe5382b7bfbc579d7a1bc7fb63c8"

/* A sample of `control/adaptation`. */
typedef struct {
    gerono_header header;               /* Common header. */
    double eta_hat;                     /* η̂, estimate of 1/m before projection, 1/kg. */
    double eta_projected;               /* π(η̂), 1/kg. */
    double mass_estimate;               /* m̂ = 1/π(η̂), kg. */
    double disturbance_hat_world[3];    /* b̂ in {I} before projection, m/s². */
    double disturbance_projected_world[3]; /* π(b̂) in {I}, m/s². */
    double w_hat[15];                   /* ŵ: Diag(J), η Diag(J), J1 b, J2 b, J3 b. */
    double observer_mass_estimate;      /* m̂ of the immersion-and-invariance observer, kg; 0 without one. */
    uint32_t inputs_refused;            /* Impossible inputs refused since the start of the flight. */
    uint8_t resting;                    /* `true` if the estimates are frozen, because there are no valid data to adapt to. */
    uint8_t stage;                      /* Failsafe stage: the law, or by the age of its inputs a safer command. */
    uint8_t pad0[2];                    /* Explicit padding. */
} gerono_control_adaptation;
#define GERONO_CONTROL_ADAPTATION_STAGE_LAW 0
#define GERONO_CONTROL_ADAPTATION_STAGE_HOLD 1
#define GERONO_CONTROL_ADAPTATION_STAGE_LEVEL 2
#define GERONO_CONTROL_ADAPTATION_STAGE_DESCEND 3
#define GERONO_CONTROL_ADAPTATION_STAGE_FAILSAFE 4
GERONO_ASSERT(sizeof(gerono_control_adaptation) == 232, "another layout of gerono_control_adaptation");
#define GERONO_CONTROL_ADAPTATION_LAYOUT "6e0e142720a1c6d0c4da5ddbfcfb8ece"

/* A sample of `control/errors`. */
typedef struct {
    gerono_header header;               /* Common header. */
    double z1[3];                       /* z1 = p − pd(γ), eq. (7), m. */
    double z2[3];                       /* z2, eq. (9), m/s. */
    double z3[3];                       /* z3 = ω − ωd, eq. (18), rad/s. */
    double z4;                          /* z4 = γ̇ − γ̇d, eq. (22), 1/s. */
    double zeta[3];                     /* ζ of section IV, m/s². */
    double omega_desired[3];            /* ωd, virtual angular velocity, rad/s. */
} gerono_control_errors;
GERONO_ASSERT(sizeof(gerono_control_errors) == 152, "another layout of gerono_control_errors");
#define GERONO_CONTROL_ERRORS_LAYOUT "357b4d7d79bfcf95049e1f031ab67e34"

/* A sample of `rc/frame`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint16_t channels[16];              /* Channels as sent, in the link's units: thrust, roll rate, pitch rate, yaw rate, then unused ones; all zero on the ideal link and in failsafe frames. */
    double thrust;                      /* T commanded by the frame, N. */
    double torque_body[3];              /* τ commanded by the frame in {B}, N m; with `MODE_TORQUE`. */
    double rates_body[3];               /* Body rates commanded by the frame in {B}, rad/s; with `MODE_RATES`. */
    uint32_t mode;                      /* Quantities that the vehicle shall follow. */
    uint32_t saturated_frames;          /* Saturated frames since the start of the flight, this one included. */
    uint32_t commands_refused;          /* Invalid commands refused since the start of the flight. */
    uint8_t failsafe;                   /* `true` for a failsafe frame: the motors stop. */
    uint8_t saturated;                  /* `true` if a limit changed the controller's command by more than the link's resolution. */
    uint8_t stage;                      /* Content of the frame: the newest command, or by its age a safer one. */
    uint8_t limit;                      /* Limit of the envelope to which `action` belongs; none if the operator killed. */
    uint8_t action;                     /* Action of the transmitter for the limit: a warning, a demand to land, or a permanent stop of the motors. */
    uint8_t inputs_fresh;               /* `true` if the transmitter's required inputs exist and are recent. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_rc_frame;
#define GERONO_RC_FRAME_MODE_TORQUE 0
#define GERONO_RC_FRAME_MODE_RATES 1
#define GERONO_RC_FRAME_STAGE_COMMAND 0
#define GERONO_RC_FRAME_STAGE_HOLD 1
#define GERONO_RC_FRAME_STAGE_FAILSAFE 4
#define GERONO_RC_FRAME_LIMIT_NONE 0
#define GERONO_RC_FRAME_LIMIT_BOX 1
#define GERONO_RC_FRAME_LIMIT_TILT 2
#define GERONO_RC_FRAME_LIMIT_SPEED 3
#define GERONO_RC_FRAME_LIMIT_ESTIMATE 4
#define GERONO_RC_FRAME_LIMIT_THRUST 5
#define GERONO_RC_FRAME_LIMIT_TORQUE 6
#define GERONO_RC_FRAME_LIMIT_RATES 7
#define GERONO_RC_FRAME_LIMIT_LANDING_TIME 8
#define GERONO_RC_FRAME_ACTION_NONE 0
#define GERONO_RC_FRAME_ACTION_WARN 1
#define GERONO_RC_FRAME_ACTION_LAND 2
#define GERONO_RC_FRAME_ACTION_KILL 3
GERONO_ASSERT(sizeof(gerono_rc_frame) == 136, "another layout of gerono_rc_frame");
#define GERONO_RC_FRAME_LAYOUT "bd9c2c63de082845304d0f4f9161775d"

/* A sample of `run/events`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint32_t kind;                      /* Kind of the event. */
    uint32_t text_length;               /* Length of `text`, bytes. */
    uint8_t text[120];                  /* The event as text, UTF-8, filled up with zeros. */
} gerono_run_event;
#define GERONO_RUN_EVENT_KIND_FLIGHT_STARTS 1
#define GERONO_RUN_EVENT_KIND_VEHICLE_CHANGES 2
#define GERONO_RUN_EVENT_KIND_FLIGHT_ENDS 3
#define GERONO_RUN_EVENT_KIND_OUTAGE_BEGINS 4
#define GERONO_RUN_EVENT_KIND_OUTAGE_ENDS 5
#define GERONO_RUN_EVENT_KIND_EDGE_FAULT_BEGINS 6
#define GERONO_RUN_EVENT_KIND_EDGE_FAULT_ENDS 7
#define GERONO_RUN_EVENT_KIND_OPERATOR_ARMS 8
#define GERONO_RUN_EVENT_KIND_OPERATOR_LANDS 9
#define GERONO_RUN_EVENT_KIND_OPERATOR_KILLS 10
#define GERONO_RUN_EVENT_KIND_OPERATOR_DISARMS 11
GERONO_ASSERT(sizeof(gerono_run_event) == 152, "another layout of gerono_run_event");
#define GERONO_RUN_EVENT_LAYOUT "85a75c37157583e96d59faf45b69bde8"

/* A sample of `control/telemetry`. */
typedef struct {
    gerono_header header;               /* Common header. */
    double values[32];                  /* The numbers in the order of their names; zero after them. */
} gerono_control_telemetry;
GERONO_ASSERT(sizeof(gerono_control_telemetry) == 280, "another layout of gerono_control_telemetry");
#define GERONO_CONTROL_TELEMETRY_LAYOUT "a6922d2eefbb6f0f71554cf4f2015233"

/* A sample of `imu/sample`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t measured_ns;               /* End of this time, ns since the start of the flight. */
    double angular_velocity_body[3];    /* Angular velocity in {B}, rad/s. */
    double specific_force_body[3];      /* Specific force in {B}, m/s². */
    uint8_t measured;                   /* `true` if something was measured; if not, all else is zero. */
    uint8_t clipped;                    /* `true` if a component is at the end of its range. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_imu_sample;
GERONO_ASSERT(sizeof(gerono_imu_sample) == 88, "another layout of gerono_imu_sample");
#define GERONO_IMU_SAMPLE_LAYOUT "d99a8b333c35bfda91bc6617644322d0"

/* A sample of `gnss/fix`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t valid_ns;                  /* Time at which the fix is valid, ns since the start of the flight. */
    double latitude;                    /* Geodetic latitude (WGS-84), degrees. */
    double longitude;                   /* Longitude (WGS-84), degrees. */
    double height;                      /* Height above the ellipsoid, m. */
    double velocity_ned[3];             /* Velocity to the north, to the east and downwards, m/s. */
    double horizontal_accuracy;         /* Standard deviation of the horizontal position over both directions, as reported, m. */
    double vertical_accuracy;           /* Standard deviation of the height, as reported, m. */
    double speed_accuracy;              /* Standard deviation of a component of the velocity, as reported, m/s. */
    uint8_t kind;                       /* What the receiver has solved. */
    uint8_t measured;                   /* `true` if there is a fix; if not, all else is zero. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_gnss_fix;
#define GERONO_GNSS_FIX_KIND_SINGLE_POINT 0
#define GERONO_GNSS_FIX_KIND_RTK_FLOAT 1
#define GERONO_GNSS_FIX_KIND_RTK_FIXED 2
GERONO_ASSERT(sizeof(gerono_gnss_fix) == 112, "another layout of gerono_gnss_fix");
#define GERONO_GNSS_FIX_LAYOUT "a882575257a1cc6668609c9371e4804a"

/* A sample of `baro/altitude`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t measured_ns;               /* Time of the measurement, ns since the start of the flight. */
    double altitude;                    /* Altitude above the origin of {I}, m. */
    uint8_t measured;                   /* `true` if something was measured; if not, all else is zero. */
    uint8_t pad0[7];                    /* Explicit padding. */
} gerono_baro_altitude;
GERONO_ASSERT(sizeof(gerono_baro_altitude) == 48, "another layout of gerono_baro_altitude");
#define GERONO_BARO_ALTITUDE_LAYOUT "bec1e531409a19056d0179b0da213658"

/* A sample of `mag/field`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t measured_ns;               /* Time of the measurement, ns since the start of the flight. */
    double field_body[3];               /* Field in {B}, G. */
    uint8_t measured;                   /* `true` if something was measured; if not, all else is zero. */
    uint8_t pad0[7];                    /* Explicit padding. */
} gerono_mag_field;
GERONO_ASSERT(sizeof(gerono_mag_field) == 64, "another layout of gerono_mag_field");
#define GERONO_MAG_FIELD_LAYOUT "177a1001a689c9b9a22778c1d381a35b"

/* A sample of `navigation/innovations`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t valid_ns[6];               /* Time of validity of the last measurement of each source, ns since the start of the flight; 0 for none. Sources: position and velocity of a fix, field, altitude, zero velocity and rate of a vehicle at rest. */
    double innovations[18];             /* Innovations of these measurements, three numbers a source: m and m/s in {I}, G in {B}, m and two zeros, m/s in {I}, rad/s in {B}. */
    double variances[18];               /* Their predicted variances. */
    double normalised_squares[6];       /* Their normalised squares: χ² of three degrees of freedom, of an altitude of one. */
    uint32_t fused[6];                  /* Measurements fused since the start of the flight. */
    uint32_t refused[6];                /* Measurements beyond the gate since the start of the flight. */
    uint32_t unusable[6];               /* Measurements that were late, from the future, not finite, or too many, since the start of the flight. */
    uint8_t accepted[6];                /* `true` if the last measurement was within the gate. */
    uint8_t pad0[2];                    /* Explicit padding. */
} gerono_navigation_innovations;
GERONO_ASSERT(sizeof(gerono_navigation_innovations) == 488, "another layout of gerono_navigation_innovations");
#define GERONO_NAVIGATION_INNOVATIONS_LAYOUT "aa2faefe0b9882682447cbc27bf0cc48"

/* A sample of `navigation/poses`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t valid_ns[2];               /* Time of validity of the last measurement of each source, ns since the start of the flight; 0 for none. Sources: position and attitude of a pose. */
    double innovations[6];              /* Innovations of these measurements, three numbers a source: m in {I}, and rad in {B}. */
    double variances[6];                /* Their predicted variances. */
    double normalised_squares[2];       /* Their normalised squares: χ² of three degrees of freedom. */
    uint32_t fused[2];                  /* Measurements fused since the start of the flight. */
    uint32_t refused[2];                /* Measurements beyond the gate since the start of the flight. */
    uint32_t unusable[2];               /* Measurements that were late, from the future, not finite, or too many, since the start of the flight. */
    uint8_t accepted[2];                /* `true` if the last measurement was within the gate. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_pose_innovations;
GERONO_ASSERT(sizeof(gerono_pose_innovations) == 184, "another layout of gerono_pose_innovations");
#define GERONO_POSE_INNOVATIONS_LAYOUT "20815ccf52a7f87e2805213f6ad663a4"

/* A sample of `gnss/baseline`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t valid_ns;                  /* Time at which the baseline is valid, ns since the start of the flight. */
    double baseline_ned[3];             /* Baseline to the north, to the east and downwards, m. */
    double accuracies_ned[3];           /* Its standard deviations, as reported, m. */
    uint8_t fixed;                      /* `true` if the numbers of carrier waves are known; else it is too inaccurate to be used. */
    uint8_t measured;                   /* `true` if there is a baseline; if not, all else is zero. */
    uint8_t pad0[6];                    /* Explicit padding. */
} gerono_gnss_baseline;
GERONO_ASSERT(sizeof(gerono_gnss_baseline) == 88, "another layout of gerono_gnss_baseline");
#define GERONO_GNSS_BASELINE_LAYOUT "57351991b762981df3a815bef0861b19"

/* A sample of `navigation/baseline`. */
typedef struct {
    gerono_header header;               /* Common header. */
    uint64_t valid_ns[1];               /* Time of validity of the last baseline, ns since the start of the flight; 0 for none. */
    double innovations[3];              /* Its innovation in {I}, m. */
    double variances[3];                /* Its predicted variances. */
    double normalised_squares[1];       /* Its normalised square: χ² of three degrees of freedom. */
    uint32_t fused[1];                  /* Baselines fused since the start of the flight. */
    uint32_t refused[1];                /* Baselines beyond the gate since the start of the flight. */
    uint32_t unusable[1];               /* Baselines that were late, from the future, not finite, or too many, since the start of the flight. */
    uint8_t accepted[1];                /* `true` if the last baseline was within the gate. */
    uint8_t pad0[3];                    /* Explicit padding. */
} gerono_baseline_innovations;
GERONO_ASSERT(sizeof(gerono_baseline_innovations) == 104, "another layout of gerono_baseline_innovations");
#define GERONO_BASELINE_INNOVATIONS_LAYOUT "0146992e6bfd59a4b6bb2ba809fe4f22"

/* Inputs and outputs of `plant`. */
enum {
    GERONO_PLANT_IN_FRAME = 0,
    GERONO_PLANT_OUT_TRUTH = 0,
    GERONO_PLANT_OUT_POSE = 1,
    GERONO_PLANT_OUT_IMU = 2,
    GERONO_PLANT_OUT_FIX = 3,
    GERONO_PLANT_OUT_ALTITUDE = 4,
    GERONO_PLANT_OUT_FIELD = 5,
    GERONO_PLANT_OUT_BASELINE = 6,
};
#define GERONO_PLANT_LAYOUTS {GERONO_RC_FRAME_LAYOUT, GERONO_VEHICLE_TRUTH_LAYOUT, GERONO_MOCAP_POSE_LAYOUT, GERONO_IMU_SAMPLE_LAYOUT, GERONO_GNSS_FIX_LAYOUT, GERONO_BARO_ALTITUDE_LAYOUT, GERONO_MAG_FIELD_LAYOUT, GERONO_GNSS_BASELINE_LAYOUT}

/* Inputs and outputs of `estimator`. */
enum {
    GERONO_ESTIMATOR_IN_POSE = 0,
    GERONO_ESTIMATOR_IN_FRAME = 1,
    GERONO_ESTIMATOR_IN_IMU = 2,
    GERONO_ESTIMATOR_IN_FIX = 3,
    GERONO_ESTIMATOR_IN_ALTITUDE = 4,
    GERONO_ESTIMATOR_IN_FIELD = 5,
    GERONO_ESTIMATOR_IN_BASELINE = 6,
    GERONO_ESTIMATOR_OUT_STATE = 0,
    GERONO_ESTIMATOR_OUT_INNOVATIONS = 1,
    GERONO_ESTIMATOR_OUT_POSES = 2,
    GERONO_ESTIMATOR_OUT_BASELINES = 3,
};
#define GERONO_ESTIMATOR_LAYOUTS {GERONO_MOCAP_POSE_LAYOUT, GERONO_RC_FRAME_LAYOUT, GERONO_IMU_SAMPLE_LAYOUT, GERONO_GNSS_FIX_LAYOUT, GERONO_BARO_ALTITUDE_LAYOUT, GERONO_MAG_FIELD_LAYOUT, GERONO_GNSS_BASELINE_LAYOUT, GERONO_VEHICLE_STATE_LAYOUT, GERONO_NAVIGATION_INNOVATIONS_LAYOUT, GERONO_POSE_INNOVATIONS_LAYOUT, GERONO_BASELINE_INNOVATIONS_LAYOUT}

/* Inputs and outputs of `path_generator`. */
enum {
    GERONO_PATH_GENERATOR_IN_STATE = 0,
    GERONO_PATH_GENERATOR_IN_FRAME = 1,
    GERONO_PATH_GENERATOR_OUT_REFERENCE = 0,
};
#define GERONO_PATH_GENERATOR_LAYOUTS {GERONO_VEHICLE_STATE_LAYOUT, GERONO_RC_FRAME_LAYOUT, GERONO_PATH_REFERENCE_LAYOUT}

/* Inputs and outputs of `controller`. */
enum {
    GERONO_CONTROLLER_IN_STATE = 0,
    GERONO_CONTROLLER_IN_REFERENCE = 1,
    GERONO_CONTROLLER_OUT_COMMAND = 0,
    GERONO_CONTROLLER_OUT_ADAPTATION = 1,
    GERONO_CONTROLLER_OUT_ERRORS = 2,
    GERONO_CONTROLLER_OUT_TELEMETRY = 3,
};
#define GERONO_CONTROLLER_LAYOUTS {GERONO_VEHICLE_STATE_LAYOUT, GERONO_PATH_REFERENCE_LAYOUT, GERONO_CONTROL_COMMAND_LAYOUT, GERONO_CONTROL_ADAPTATION_LAYOUT, GERONO_CONTROL_ERRORS_LAYOUT, GERONO_CONTROL_TELEMETRY_LAYOUT}

/* Inputs and outputs of `rc_output`. */
enum {
    GERONO_RC_OUTPUT_IN_COMMAND = 0,
    GERONO_RC_OUTPUT_IN_STATE = 1,
    GERONO_RC_OUTPUT_OUT_FRAME = 0,
};
#define GERONO_RC_OUTPUT_LAYOUTS {GERONO_CONTROL_COMMAND_LAYOUT, GERONO_VEHICLE_STATE_LAYOUT, GERONO_RC_FRAME_LAYOUT}

/* End of what is generated. */
#ifdef __cplusplus
}
#endif
#endif
