/* The machine for one thread, misused from C. The library holds 3 clouds with a window of 16, and 5 with 40. */
#include "cases.h"

static const uint64_t ms = FUSELINE_MILLISECOND;
static fuseline_storage_c3w16 storage, other;
static fuseline_machine *machine;

static fuseline_status init(const fuseline_config *config) { return fuseline_init(&storage, sizeof storage, config, &machine); }
static void fresh(void) {
  const fuseline_config config = valid();
  HOLDS(init(&config) == FUSELINE_STATUS_DONE);
}
static void progressive(void) {
  fuseline_config config = valid();
  config.commit = FUSELINE_COMMIT_PROGRESSIVE;
  HOLDS(init(&config) == FUSELINE_STATUS_DONE);
}
/* A configuration that is refused, and writes nothing. */
static void refused(const fuseline_config *config, fuseline_status expected) {
  const fuseline_storage_c3w16 before = storage;
  machine = NULL;
  HOLDS(init(config) == expected);
  HOLDS(machine == NULL && memcmp(&before, &storage, sizeof storage) == 0);
}
static void opened(uint64_t now, uint64_t t) { IS(fuseline_open(machine, now, t, &a), FUSELINE_OUTCOME_ACCEPTED); }
static void offered(uint64_t now, uint64_t t, uint64_t p) {
  IS(fuseline_offer(machine, now, t, p, 400 * ms, 0, &a), FUSELINE_OUTCOME_ADMITTED);
}

/* --- pointers and lifetimes --- */

CASE(c_null_machine, "passes a null machine", "status `null`") { HOLDS(fuseline_open(NULL, 0, 1, &a) == FUSELINE_STATUS_NULL); }
CASE(c_null_answer, "passes a null answer", "status `null`") {
  fresh();
  HOLDS(fuseline_open(machine, 0, 1, NULL) == FUSELINE_STATUS_NULL);
  opened(0, 1); /* nothing had changed */
}
CASE(c_misaligned_machine, "passes a misaligned machine", "status `alignment`") {
  fresh();
  HOLDS(fuseline_open((fuseline_machine *)(void *)((char *)machine + 1), 0, 1, &a) == FUSELINE_STATUS_ALIGNMENT);
}
CASE(c_answer_in_machine, "puts the answer into the machine's storage", "status `overlap`") {
  fresh();
  HOLDS(fuseline_open(machine, 0, 1, (fuseline_answer *)(void *)&storage.opaque[8]) == FUSELINE_STATUS_OVERLAP);
  opened(0, 1);
}
CASE(c_machine_pointer_in_storage, "lets `fuseline_init` write the machine's address into its own storage", "status `overlap`; nothing is written") {
  const fuseline_config config = valid();
  fuseline_storage_c3w16 before;
  memset(&storage, 0x3c, sizeof storage);
  before = storage;
  HOLDS(fuseline_init(&storage, sizeof storage, &config, (fuseline_machine **)(void *)&storage.opaque[1]) == FUSELINE_STATUS_OVERLAP);
  HOLDS(memcmp(&before, &storage, sizeof storage) == 0);
}
CASE(c_capacity_overwritten, "overwrites the capacity in the head of the storage", "status `foreign`") {
  fresh();
  storage.opaque[2] = 0;
  HOLDS(fuseline_open(machine, 0, 1, &a) == FUSELINE_STATUS_FOREIGN && fuseline_end(machine) == FUSELINE_STATUS_FOREIGN);
}
CASE(c_never_initialised, "uses a machine without `fuseline_init`", "status `foreign`") {
  memset(&other, 0, sizeof other);
  HOLDS(fuseline_open((fuseline_machine *)(void *)&other, 0, 1, &a) == FUSELINE_STATUS_FOREIGN);
}
CASE(c_used_after_end, "uses a machine after `fuseline_end`", "status `foreign`") {
  fresh();
  HOLDS(fuseline_end(machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_open(machine, 0, 1, &a) == FUSELINE_STATUS_FOREIGN);
}
CASE(c_ended_twice, "ends a machine twice", "status `foreign`") {
  fresh();
  HOLDS(fuseline_end(machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_end(machine) == FUSELINE_STATUS_FOREIGN);
}
CASE(c_copied, "uses a copy of a machine's bytes", "status `foreign`; the original still works") {
  fresh();
  other = storage;
  HOLDS(fuseline_open((fuseline_machine *)(void *)&other, 0, 1, &a) == FUSELINE_STATUS_FOREIGN);
  opened(0, 1);
}

/* --- shapes and configurations --- */

CASE(c_small_storage, "gives too little storage", "status `size`") {
  const fuseline_config config = valid();
  HOLDS(fuseline_init(&storage, fuseline_bytes(config.capacity) - 1U, &config, &machine) == FUSELINE_STATUS_SIZE);
}
CASE(c_other_abi, "uses a header of another version", "status `abi`") {
  fuseline_config config = valid();
  config.abi -= 1U;
  refused(&config, FUSELINE_STATUS_ABI);
  HOLDS(fuseline_abi() == FUSELINE_ABI && strlen(fuseline_version()) > 0U);
}
CASE(c_other_layout, "lays the structures out differently", "status `abi`") {
  fuseline_config config = valid();
  config.layout ^= 8U;
  refused(&config, FUSELINE_STATUS_ABI);
}
CASE(c_absent_capacity, "requests a capacity that the library lacks", "status `capacity`") {
  fuseline_config config = valid();
  config.capacity = FUSELINE_CAPACITY_C15W1024;
  refused(&config, FUSELINE_STATUS_CAPACITY);
}
CASE(c_other_shape, "requests other clouds or another window than the library has", "status `capacity`; `fuseline_own_capacity` gives the library's") {
  static FUSELINE_STORAGE(15, 60) large;
  fuseline_config config = valid();
  config.capacity = FUSELINE_CAPACITY_OF(15, 40);
  HOLDS(fuseline_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_CAPACITY);
  config.capacity = FUSELINE_CAPACITY_OF(5, 60);
  HOLDS(fuseline_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_CAPACITY);
  config.capacity = FUSELINE_CAPACITY_OF(5, 39);
  HOLDS(fuseline_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_CAPACITY);
  HOLDS(fuseline_own_capacity() == FUSELINE_CAPACITY_OF(5, 40));
  config.capacity = fuseline_own_capacity();
  HOLDS(fuseline_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_DONE);
}
CASE(c_unknown_commit, "gives an unknown commit rule", "status `commit`") {
  fuseline_config config = valid();
  config.commit = 3;
  refused(&config, FUSELINE_STATUS_COMMIT);
}
CASE(c_window_range, "gives a window of 0, negative, or above the capacity", "status `window`") {
  fuseline_config config = valid();
  config.window = 0;
  refused(&config, FUSELINE_STATUS_WINDOW);
  config.window = (uint32_t)-1;
  refused(&config, FUSELINE_STATUS_WINDOW);
  config.window = 17;
  refused(&config, FUSELINE_STATUS_WINDOW);
}
CASE(c_too_many_clouds, "gives more clouds than the capacity, or a negative number", "status `clouds`") {
  fuseline_config config = valid();
  config.clouds_len = 4;
  refused(&config, FUSELINE_STATUS_CLOUDS);
  config.clouds_len = (uint32_t)-1;
  refused(&config, FUSELINE_STATUS_CLOUDS);
}
CASE(c_null_clouds, "gives a number of clouds and a null array", "status `null`") {
  fuseline_config config = valid();
  config.clouds = NULL;
  refused(&config, FUSELINE_STATUS_NULL);
}
CASE(c_priority_range, "gives a cloud priority 0 (local's), negative, or above 65535", "status `priority`") {
  const uint64_t wrong[] = {0, 65536, (uint64_t)-1};
  fuseline_config config = valid();
  unsigned i;
  for (i = 0; i < 3U; ++i) {
    const fuseline_cloud cloud = {wrong[i], 31, 30};
    config.clouds = &cloud;
    config.clouds_len = 1;
    refused(&config, FUSELINE_STATUS_PRIORITY);
  }
}
CASE(c_same_priority, "gives two clouds the same priority", "status `twice`") {
  const fuseline_cloud twins[] = {{1, 31, 30}, {1, 31, 30}};
  fuseline_config config = valid();
  config.clouds = twins;
  config.clouds_len = 2;
  refused(&config, FUSELINE_STATUS_TWICE);
}
CASE(c_gate_range, "gives a gate that resumes at its limit, or limit 0", "status `gate`") {
  const fuseline_cloud shut[] = {{1, 31, 31}, {1, 0, 0}};
  fuseline_config config = valid();
  config.clouds_len = 1;
  for (config.clouds = shut; config.clouds < shut + 2; ++config.clouds) refused(&config, FUSELINE_STATUS_GATE);
}
CASE(c_no_greatest_deadline, "sets no greatest deadline", "status `deadline`") {
  fuseline_config config = valid();
  config.greatest_deadline = 0;
  refused(&config, FUSELINE_STATUS_DEADLINE);
}

/* --- units and signs --- */

CASE(c_negative_deadline, "gives a negative deadline: the budget is used up", "refused `deadline`, wrapped or by `fuseline_deadline`") {
  const uint64_t budget = 30 * ms, age = 50 * ms;
  fresh();
  REFUSED(fuseline_open_within(machine, 0, 1, budget - age, &a), FUSELINE_REASON_DEADLINE);
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, budget - age, 0, &a), FUSELINE_REASON_DEADLINE);
  REFUSED(fuseline_offer(machine, 0, 1, 1, fuseline_deadline(30 - 50, ms), 0, &a), FUSELINE_REASON_DEADLINE);
  IS(fuseline_result(machine, 1, 1, 0, &a), FUSELINE_OUTCOME_FORWARDED); /* nothing holds local's result back */
}
CASE(c_deadline_of_0, "gives a deadline of 0", "refused `deadline`") {
  fresh();
  REFUSED(fuseline_open_within(machine, 0, 1, 0, &a), FUSELINE_REASON_DEADLINE);
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, 0, 0, &a), FUSELINE_REASON_DEADLINE);
}
CASE(c_too_great_a_unit, "multiplies nanoseconds as if they were milliseconds", "refused `deadline`: above the greatest") {
  fresh();
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, 400 * ms * ms, 0, &a), FUSELINE_REASON_DEADLINE);
  REFUSED(fuseline_offer(machine, 0, 1, 1, fuseline_deadline(INT64_MAX, FUSELINE_SECOND), 0, &a), FUSELINE_REASON_DEADLINE);
}
CASE(c_product_of_units, "multiplies a unit by an int: 5 * FUSELINE_SECOND", "64 bits: the product does not wrap at 32") {
  fuseline_config config = valid();
  const int seconds = 7;
  config.greatest_deadline = (unsigned)seconds * FUSELINE_SECOND;
  HOLDS(config.greatest_deadline == 7000000000U && 6000000 * FUSELINE_MICROSECOND == 6000000000U);
  HOLDS(init(&config) == FUSELINE_STATUS_DONE);
  opened(0, 1);
  IS(fuseline_offer(machine, 0, 1, 1, 6500 * FUSELINE_MILLISECOND, 0, &a), FUSELINE_OUTCOME_ADMITTED);
  HOLDS(a.due == 6500000000U);
}
CASE(c_too_small_a_unit, "gives milliseconds as nanoseconds", "the timer fires at once: local's result is forwarded, the cloud's are dropped `late` or `superseded`") {
  fresh();
  opened(0, 1);
  IS(fuseline_offer(machine, 0, 1, 1, 400, 0, &a), FUSELINE_OUTCOME_ADMITTED);
  HOLDS(fuseline_result(machine, 30 * ms, 1, 1, &a) == FUSELINE_STATUS_AGAIN && a.due == 400);
  DROPPED(fuseline_result(machine, 30 * ms, 1, 1, &a), FUSELINE_REASON_LATE);
  IS(fuseline_result(machine, 30 * ms, 1, 0, &a), FUSELINE_OUTCOME_FORWARDED);
}
CASE(c_clock_goes_back, "gives an earlier `now` than before", "the greatest `now` so far counts; `at` of the answer shows it") {
  fresh();
  opened(50 * ms, 1);
  opened(20 * ms, 2);
  HOLDS(a.at == 50 * ms);
}
CASE(c_ticks_wrap, "makes instants of a counter of 32 bits, which wraps", "the greatest `now` so far counts; `at` of the answer is above `now` and shows it") {
  uint32_t ticks = UINT32_MAX - 4U; /* milliseconds: after 49 days */
  fresh();
  opened(ticks * ms, 1);
  offered(ticks * ms, 1, 1);
  ticks += 500U;
  IS(fuseline_result(machine, ticks * ms, 1, 0, &a), FUSELINE_OUTCOME_HELD);
  HOLDS(ticks < 500U && a.at == (UINT32_MAX - 4U) * ms && a.at > ticks * ms);
}
CASE(c_negative_instant, "gives a negative reading of the clock, which wraps", "all that is due fires; later deadlines are refused `deadline`; `fuseline_instant` gives 0") {
  fresh();
  opened(0, 1);
  offered(0, 1, 1);
  HOLDS(fuseline_tick(machine, (uint64_t)-1, &a) == FUSELINE_STATUS_AGAIN && a.outcome == FUSELINE_OUTCOME_WAITING);
  opened(10 * ms, 2);
  REFUSED(fuseline_offer(machine, 10 * ms, 2, 1, 400 * ms, 0, &a), FUSELINE_REASON_DEADLINE);
  HOLDS(fuseline_instant(-1, 0) == 0 && fuseline_instant(2, 5) == 2 * FUSELINE_SECOND + 5);
}

/* --- order --- */

CASE(c_timestamp_again, "opens a timestamp again, or a lower one", "refused `order`") {
  fresh();
  opened(0, 7);
  REFUSED(fuseline_open(machine, 0, 7, &a), FUSELINE_REASON_ORDER);
  REFUSED(fuseline_open(machine, 0, 6, &a), FUSELINE_REASON_ORDER);
}
CASE(c_results_never_given, "never gives results", "refused `full` once the window is full") {
  uint64_t t;
  fresh();
  for (t = 0; t < 16; ++t) opened(0, t);
  REFUSED(fuseline_open(machine, 0, t, &a), FUSELINE_REASON_FULL);
}
CASE(c_offer_before_open, "offers before it opens", "refused `unknown`") {
  fresh();
  REFUSED(fuseline_offer(machine, 0, 1, 1, ms, 0, &a), FUSELINE_REASON_UNKNOWN);
}
CASE(c_offer_after_forward, "offers after the forward", "refused `closed`") {
  fresh();
  opened(0, 1);
  IS(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_OUTCOME_FORWARDED);
  REFUSED(fuseline_offer(machine, 0, 1, 1, ms, 0, &a), FUSELINE_REASON_CLOSED);
}
CASE(c_offer_to_no_cloud, "offers to local, or to an unconfigured cloud", "refused `unknown`") {
  fresh();
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 0, ms, 0, &a), FUSELINE_REASON_UNKNOWN);
  REFUSED(fuseline_offer(machine, 0, 1, 9, ms, 0, &a), FUSELINE_REASON_UNKNOWN);
  REFUSED(fuseline_offer(machine, 0, 1, (uint64_t)-1, ms, 0, &a), FUSELINE_REASON_UNKNOWN);
}
CASE(c_offered_twice, "offers twice to a cloud", "refused `duplicate`") {
  fresh();
  opened(0, 1);
  offered(0, 1, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, ms, 0, &a), FUSELINE_REASON_DUPLICATE);
}
CASE(c_negative_backlog, "gives a negative backlog", "refused `queue`: the gate shuts") {
  fresh();
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, ms, (uint64_t)-1, &a), FUSELINE_REASON_QUEUE);
}
CASE(c_sent_though_refused, "sends a request that was refused", "its result is dropped `unsolicited`") {
  fresh();
  opened(0, 1);
  REFUSED(fuseline_offer(machine, 0, 1, 1, 0, 0, &a), FUSELINE_REASON_DEADLINE);
  DROPPED(fuseline_result(machine, 0, 1, 1, &a), FUSELINE_REASON_UNSOLICITED);
}
CASE(c_result_of_unknown, "gives a result of an unknown source or message", "dropped `unknown`") {
  fresh();
  DROPPED(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_REASON_UNKNOWN);
  opened(0, 1);
  DROPPED(fuseline_result(machine, 0, 1, 9, &a), FUSELINE_REASON_UNKNOWN);
}
CASE(c_result_twice, "gives a result twice", "dropped `duplicate` while it is held, `superseded` after the forward") {
  fresh();
  opened(0, 1);
  offered(0, 1, 1);
  IS(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_OUTCOME_HELD);
  DROPPED(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_REASON_DUPLICATE);
  IS(fuseline_result(machine, 0, 1, 1, &a), FUSELINE_OUTCOME_FORWARDED);
  DROPPED(fuseline_result(machine, 0, 1, 1, &a), FUSELINE_REASON_SUPERSEDED);
}
CASE(c_failed_after_result, "reports a failure after the result", "dropped `duplicate`; the result stays") {
  fresh();
  opened(0, 1);
  offered(0, 1, 1);
  IS(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_OUTCOME_HELD);
  DROPPED(fuseline_fail(machine, 0, 1, 0, &a), FUSELINE_REASON_DUPLICATE);
  IS(fuseline_fail(machine, 0, 1, 1, &a), FUSELINE_OUTCOME_FORWARDED);
}
CASE(c_first_output_for_the_last, "takes a preliminary output for the last: gives no more results, and uses the timestamp again", "refused `order`; the message counts in the window, refused `full`, until its timers end it, `final`") {
  uint64_t t;
  progressive();
  opened(0, 0);
  offered(0, 0, 1);
  IS(fuseline_result(machine, 0, 0, 0, &a), FUSELINE_OUTCOME_PRELIMINARY);
  REFUSED(fuseline_open(machine, 0, 0, &a), FUSELINE_REASON_ORDER);
  for (t = 1; t < 16; ++t) opened(0, t);
  REFUSED(fuseline_open(machine, 0, t, &a), FUSELINE_REASON_FULL);
  HOLDS(fuseline_open(machine, 400 * ms, t, &a) == FUSELINE_STATUS_AGAIN);
  HOLDS(a.outcome == FUSELINE_OUTCOME_FINAL && a.t == 0 && a.by == 0);
  opened(400 * ms, t);
}
CASE(c_worse_after_better, "gives a worse result after a preliminary output, or the same again", "dropped `superseded`, `duplicate`") {
  progressive();
  opened(0, 1);
  offered(0, 1, 1);
  offered(0, 1, 2);
  IS(fuseline_result(machine, 0, 1, 1, &a), FUSELINE_OUTCOME_PRELIMINARY);
  DROPPED(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_REASON_SUPERSEDED);
  DROPPED(fuseline_result(machine, 0, 1, 1, &a), FUSELINE_REASON_DUPLICATE);
}
CASE(c_output_taken_back, "reports a failure of what was sent", "dropped `duplicate`; the output stands") {
  progressive();
  opened(0, 1);
  offered(0, 1, 1);
  IS(fuseline_result(machine, 0, 1, 0, &a), FUSELINE_OUTCOME_PRELIMINARY);
  DROPPED(fuseline_fail(machine, 0, 1, 0, &a), FUSELINE_REASON_DUPLICATE);
  IS(fuseline_fail(machine, 0, 1, 1, &a), FUSELINE_OUTCOME_FINAL);
}
CASE(c_again_not_repeated, "does not repeat a call after status `again`", "`fired` of the answer is 1; the input is not applied") {
  fresh();
  opened(0, 1);
  offered(0, 1, 1);
  HOLDS(fuseline_open(machine, 400 * ms, 2, &a) == FUSELINE_STATUS_AGAIN && a.fired == 1 && a.t == 1);
  DROPPED(fuseline_result(machine, 400 * ms, 2, 0, &a), FUSELINE_REASON_UNKNOWN); /* 2 was not opened */
}
CASE(c_look_at_unknown, "looks at an unknown message or cloud", "status `none`") {
  fuseline_message message;
  uint32_t is_shut = 0;
  fresh();
  HOLDS(fuseline_look_at(machine, 1, &message) == FUSELINE_STATUS_NONE);
  HOLDS(fuseline_gate_is_shut(machine, 9, &is_shut) == FUSELINE_STATUS_NONE);
}

int main(int argc, char **argv) { return run_cases(argc > 1 ? argv[1] : NULL); }
