/* One message, one cloud that does not answer: local's result leaves at the due instant. No clock, no threads. */
#include <inttypes.h>
#include <stdio.h>

#include "fuseline.h"

static fuseline_storage_c1w4 storage;

static void print_answer(fuseline_status status, const fuseline_answer *a) {
  printf("%4" PRIu64 " ms  %-7s t %" PRIu64 " %s", a->at / 1000000U, status == FUSELINE_STATUS_AGAIN ? "timers" : "input",
         a->t, fuseline_outcome_name(a->outcome));
  if (a->why != FUSELINE_REASON_NONE) printf(" (%s)", fuseline_reason_name(a->why));
  if (a->outcome == FUSELINE_OUTCOME_FORWARDED) printf(": the result of %" PRIu32, a->by);
  printf("\n");
}

int main(void) {
  const uint64_t ms = 1000000U;
  const fuseline_cloud clouds[] = {{1, 31, 30}}; /* priority 1; its gate shuts at 31 queued requests */
  const fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C1W4, FUSELINE_COMMIT_EAGER, 4, 1, clouds,
                                  fuseline_deadline(1, FUSELINE_SECOND)};
  fuseline_machine *machine = NULL;
  fuseline_answer a;
  uint64_t due = 0;
  fuseline_status status = fuseline_init(&storage, sizeof storage, &config, &machine);
  if (status != FUSELINE_STATUS_DONE) {
    fprintf(stderr, "no machine: %s\n", fuseline_status_name(status));
    return 1;
  }

  /* A message comes: open its timestamp, and offer it to the cloud, which has 400 ms. */
  do print_answer(status = fuseline_open(machine, 0, 7, &a), &a); while (status == FUSELINE_STATUS_AGAIN);
  do print_answer(status = fuseline_offer(machine, 0, 7, 1, 400 * ms, 0, &a), &a); while (status == FUSELINE_STATUS_AGAIN);
  /* Local is ready first, and held: the cloud outranks it. */
  do print_answer(status = fuseline_result(machine, 300 * ms, 7, 0, &a), &a); while (status == FUSELINE_STATUS_AGAIN);
  /* Nothing else comes. At the due instant the best available result is forwarded. */
  if (fuseline_next_due(machine, &due) != FUSELINE_STATUS_DONE) return 1;
  while ((status = fuseline_tick(machine, due, &a)) == FUSELINE_STATUS_AGAIN) print_answer(status, &a);
  /* The cloud's result comes late, and is dropped. */
  do print_answer(status = fuseline_result(machine, 401 * ms, 7, 1, &a), &a); while (status == FUSELINE_STATUS_AGAIN);
  return fuseline_end(machine) == FUSELINE_STATUS_DONE && a.why == FUSELINE_REASON_SUPERSEDED ? 0 : 1;
}
