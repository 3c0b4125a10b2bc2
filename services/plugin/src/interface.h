/* gerono.h: a service of Gerono from a shared library, in C or C++. Made by `gerono header`.
 *
 * The library exports gerono_plugin_v1. A service has no clock, does no input or output, and does not allocate in a
 * step; its state is all on which the next step depends besides its inputs. SI units and radians. The frame {I} has its
 * third axis down, and {B} its third axis opposite to the thrust. docs/plugins.md explains the rest, and docs/topics.md
 * the members of the samples.
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

#define GERONO_ABI @VERSION@

/* Time of a step, with the operator's requests. */
typedef struct {
    uint64_t tick;       /* base tick since the start of the flight */
    uint64_t time_ns;    /* time of the tick since the start of the flight, ns */
    uint64_t elapsed_ns; /* time since this service's previous step, ns; 0 at its first */
    uint8_t armed;       /* not 0 if the motors may turn */
    uint8_t land;        /* not 0 if the vehicle must land */
    uint8_t killed;      /* not 0 if the motors stop for ever */
    uint8_t pad[5];
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

/* What a service may know when it is made. */
typedef struct {
    const char *scenario;               /* the scenario as JSON */
    const gerono_parameter *parameters; /* sorted by name */
    size_t parameter_count;
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
    for (size_t i = 0; i < setup->parameter_count; i++) {
        if (strcmp(setup->parameters[i].name, name) == 0) {
            return setup->parameters[i].value;
        }
    }
    return otherwise;
}

@SAMPLES@
@PORTS@
#ifdef __cplusplus
}
#endif
#endif
