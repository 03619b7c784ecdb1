/*
 * Cases of misuse: each has a name, what the caller does and what happens, and is run by the main of its file. Each is
 * refused or reported; what is not detected is listed in docs/book/src/use/c.md. The texts are the cells of a table.
 *
 *     misuse-c [NAME]      all, or the one of this name: a line for each, "name | misuse | what happens"
 */
#ifndef FUSELINE_TESTS_MISUSE_CASES_H
#define FUSELINE_TESTS_MISUSE_CASES_H

#include <stdint.h>
#include <string.h>

#include "../holds.h"
#include "fuseline.h"

enum { MOST_CASES = 128 };
struct misuse_case {
  const char *name, *misuse, *happens;
  void (*run)(void);
};
static struct misuse_case misuse_cases[MOST_CASES];
static unsigned misuse_len;

/* A case registers itself before main: gcc and clang have it in C and in C++. */
#define CASE(name, misuse, happens) \
  static void name(void); \
  __attribute__((constructor)) static void add_##name(void) { \
    const struct misuse_case added = {#name, misuse, happens, name}; \
    if (misuse_len == MOST_CASES) abort(); \
    misuse_cases[misuse_len++] = added; \
  } \
  static void name(void)

static int run_cases(const char *only) {
  unsigned i, run = 0;
  for (i = 0; i < misuse_len; ++i) {
    if (only != NULL && strcmp(only, misuse_cases[i].name) != 0) continue;
    holds_in = misuse_cases[i].name;
    misuse_cases[i].run();
    printf("%s | %s | %s\n", holds_in, misuse_cases[i].misuse, misuse_cases[i].happens);
    ++run;
  }
  return run > 0 ? 0 : 2; /* 2: there is no such case */
}

#ifndef __cplusplus
/* In C, cases of both kinds of machine begin with this configuration and read this answer. */
static const fuseline_cloud clouds[] = {{1, 31, 30}, {2, 31, 30}, {3, 31, 30}, {4, 31, 30}};
static fuseline_answer a;

static fuseline_config valid(void) {
  fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C3W16, FUSELINE_COMMIT_EAGER, 16, 3, clouds, 1000000000};
  return config;
}
static void answered(fuseline_status status, fuseline_outcome outcome, fuseline_reason why) {
  HOLDS(status == FUSELINE_STATUS_DONE);
  HOLDS(a.outcome == outcome && a.why == why);
}
#define REFUSED(call, why) answered(call, FUSELINE_OUTCOME_REFUSED, why)
#define DROPPED(call, why) answered(call, FUSELINE_OUTCOME_DROPPED, why)
#define IS(call, outcome) answered(call, outcome, FUSELINE_REASON_NONE)
#endif

/* A library that is not optimised keeps a panic that cannot be reached, and how to unwind it. */
#ifdef __cplusplus
extern "C" {
#endif
void fuseline_a_panic_can_be_reached(void);
void fuseline_a_panic_can_be_reached(void) {
  fprintf(stderr, "%s: a panic\n", holds_in);
  abort();
}
void rust_eh_personality(void);
void rust_eh_personality(void) { abort(); }
#ifdef __cplusplus
}
#endif

#endif /* FUSELINE_TESTS_MISUSE_CASES_H */
