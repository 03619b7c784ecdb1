/* Functions that rustc calls for instrumented copies, for runtimes of the thread sanitizer that do not have it yet. */
#include <string.h>

void *__tsan_memcpy(void *to, const void *from, size_t len);
void *__tsan_memmove(void *to, const void *from, size_t len);
void *__tsan_memset(void *to, int byte, size_t len);

/* These are seen by the runtime, which watches the C library's. */
__attribute__((weak)) void *__tsan_memcpy(void *to, const void *from, size_t len) { return memcpy(to, from, len); }
__attribute__((weak)) void *__tsan_memmove(void *to, const void *from, size_t len) { return memmove(to, from, len); }
__attribute__((weak)) void *__tsan_memset(void *to, int byte, size_t len) { return memset(to, byte, len); }

/* Instrumented, two reads of one length are not seen to be equal, and a check stays that no other build has. */
void fuseline_a_panic_can_be_reached(void);
void fuseline_a_panic_can_be_reached(void) { __builtin_trap(); }
