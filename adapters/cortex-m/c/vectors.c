/* The words that the processor reads first: the stack's top, where it begins, and where faults go. */
#include <stdint.h>

extern uint32_t __stack;
void _start(void);
void _exit(int code) __attribute__((noreturn));

static void fault(void) { _exit(9); }

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))(uintptr_t)&__stack, _start, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, fault};
