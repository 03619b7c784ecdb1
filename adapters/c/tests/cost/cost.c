/*
 * Measures what the border costs: the same inputs given to the machine from C and from Rust, in turns, in one process.
 * Six inputs a message, about four messages open, each left by its firing. Prints nanoseconds an input and the ratio, by
 * the least of all turns, which noise cannot lower, and how the ratio of one turn is spread. A ratio in the middle above
 * the first argument (1.1) is exit code 2; the second is how many turns there are, at most and by default 5000.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fuseline.h"

enum { MESSAGES = 500, TURNS = 5000 };

uint64_t fuseline_cost_in_rust(uint64_t messages);

static fuseline_storage_c3w16 storage;
static uint64_t forwarded;

static void act(const fuseline_answer *a) {
  if (a->outcome == FUSELINE_OUTCOME_FORWARDED) ++forwarded;
}

static uint64_t in_c(uint64_t messages) {
  const fuseline_cloud clouds[] = {{1, 31, 30}, {2, 31, 30}, {3, 31, 30}};
  const fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C3W16, FUSELINE_COMMIT_EAGER, 16, 3, clouds, 1000};
  fuseline_machine *machine = NULL;
  fuseline_answer a;
  uint64_t t, p;
  forwarded = 0;
  if (fuseline_init(&storage, sizeof storage, &config, &machine) != FUSELINE_STATUS_DONE) return 0;
  for (t = 0; t < messages; ++t) {
    uint64_t now = t * 100U;
    while (fuseline_open(machine, now, t, &a) == FUSELINE_STATUS_AGAIN) act(&a);
    for (p = 1; p <= 3U; ++p) {
      while (fuseline_offer(machine, now, t, p, 350, 0, &a) == FUSELINE_STATUS_AGAIN) act(&a);
    }
    for (p = 0; p <= 2U; p += 2U) {
      while (fuseline_result(machine, now + 20U, t, p, &a) == FUSELINE_STATUS_AGAIN) act(&a);
      act(&a);
    }
  }
  return forwarded;
}

/* Called through these, so that a profiler has each by its name. */
static uint64_t (*const volatile called_from_c)(uint64_t) = in_c;
static uint64_t (*const volatile called_from_rust)(uint64_t) = fuseline_cost_in_rust;

static double ns_an_input(uint64_t (*run)(uint64_t), uint64_t *result) {
  struct timespec begin, end;
  clock_gettime(CLOCK_MONOTONIC, &begin);
  *result = run(MESSAGES);
  clock_gettime(CLOCK_MONOTONIC, &end);
  return ((double)(end.tv_sec - begin.tv_sec) * 1e9 + (double)(end.tv_nsec - begin.tv_nsec)) / (6.0 * MESSAGES);
}

static double ratios[TURNS];

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

int main(int argc, char **argv) {
  double most = argc > 1 ? strtod(argv[1], NULL) : 1.1;
  double c = 1e9, rust = 1e9;
  uint64_t of_c = 0, of_rust = 0;
  size_t turns = argc > 2 ? strtoul(argv[2], NULL, 10) : TURNS, i;
  if (turns < 1 || turns > TURNS) return 1;
  for (i = 0; i < turns; ++i) {
    double of_this = ns_an_input(called_from_c, &of_c);
    double beside = ns_an_input(called_from_rust, &of_rust);
    if (of_this < c) c = of_this;
    if (beside < rust) rust = beside;
    ratios[i] = of_this / beside;
  }
  if (of_c != of_rust || of_c == 0) {
    fprintf(stderr, "error: C forwarded %llu, Rust %llu\n", (unsigned long long)of_c, (unsigned long long)of_rust);
    return 1;
  }
  qsort(ratios, turns, sizeof ratios[0], by_size);
  printf("an input at (3, 16): %.1f ns from C, %.1f ns from Rust, %.2f times\n", c, rust, c / rust);
  printf("of %zu turns: %.2f times in the middle, %.2f to %.2f for nine of ten\n", turns, ratios[turns / 2],
         ratios[turns / 20], ratios[turns - 1 - turns / 20]);
  return ratios[turns / 2] <= most ? 0 : 2;
}
