/* The example's controller, which does something once that it should not: MISCONDUCT, in its step at tick 500, after
 * the law; or else in what it says of itself: CLAIM. Both are given on the compiler's command line. */
#define _POSIX_C_SOURCE 200809L
#define gerono_plugin_v1 example
#include "pid.c"
#undef gerono_plugin_v1
#include <pthread.h>
#include <unistd.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#ifdef FAST_MATH /* what -ffast-math links with */
__attribute__((constructor)) static void flush_to_zero(void) { _mm_setcsr(_mm_getcsr() | 0x8040); }
#endif

#ifndef MISCONDUCT
#define MISCONDUCT
#endif
#ifndef CLAIM
#define CLAIM
#endif

static int it_forgets;

static void *leave_in_thread(void *nothing) { exit(0); }

static int misbehave(void *self, const gerono_now *now, const gerono_input *in, const gerono_output *out) {
    int result = step(self, now, in, out);
    gerono_control_command *command = out[GERONO_CONTROLLER_OUT_COMMAND].sample;
    (void)command;
    if (now->tick == 500) {
        MISCONDUCT;
    }
    return result;
}

static void save_too_much(const void *self, void *to) { save(self, to); memset((char *)to + state_size(self), 1, 8); }
static void save_until_asked(const void *self, void *to) { if (it_forgets) memset(to, 0, state_size(self)); else save(self, to); }
static void save_nothing(const void *self, void *to) { (void)self; memset(to, 0, sizeof(double[3])); }
static void flush(void) {
#ifdef __x86_64__
    _mm_setcsr(_mm_getcsr() | 0x8040);
#endif
}
static void *create_and_flush(const gerono_setup *setup, char *why_not, size_t size) { flush(); return create(setup, why_not, size); }
static size_t size_and_flush(const void *self) { flush(); return state_size(self); }
static void save_and_flush(const void *self, void *to) { flush(); save(self, to); }
static size_t growing(const void *self) { static size_t calls = 0; return state_size(self) + 8 * (calls++ > 5); }
static size_t enormous(const void *self) { (void)self; return 1 << 20; }
static size_t varying(const void *self) { return state_size(self) + 8 * (getpid() % 1024); }
static size_t negative(const void *self) { (void)self; return -1; }
static void *leave(const gerono_setup *setup, char *why_not, size_t size) { exit(0); }
static void leave_at_the_end(void *self) { exit(0); }
static void never(void *self) { for (;;) pause(); }
static void *refuse(const gerono_setup *setup, char *why_not, size_t size) {
    (void)setup;
    strncpy(why_not, "it flies on Sundays only", size - 1);
    return NULL;
}

const gerono_plugin *gerono_plugin_v1(void) {
    static gerono_plugin it;
    static const char *const others[] = {GERONO_VEHICLE_STATE_LAYOUT, "0", "0", "0", "0", "0"};
    (void)create_and_flush, (void)size_and_flush, (void)save_and_flush, (void)growing, (void)save_until_asked;
    (void)save_too_much, (void)save_nothing, (void)enormous, (void)negative, (void)varying, (void)leave, (void)leave_at_the_end, (void)never, (void)refuse, (void)others;
    it = PLUGIN;
    it.step = misbehave;
    CLAIM;
    return &it;
}
