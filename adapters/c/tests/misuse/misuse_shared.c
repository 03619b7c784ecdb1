/* The machine for many threads, misused from C by one thread. */
#include "cases.h"

typedef FUSELINE_SHARED_STORAGE(3, 16) storage_type;
static storage_type storage, other;
static fuseline_shared *machine;
static fuseline_answer fired;
static fuseline_message_id message_id;

static void fresh(void) {
  const fuseline_config config = valid();
  HOLDS(fuseline_shared_init(&storage, sizeof storage, &config, &machine) == FUSELINE_STATUS_DONE);
  IS(fuseline_shared_open(machine, 0, 1, &message_id, &a), FUSELINE_OUTCOME_ACCEPTED);
}

CASE(shared_negative_deadline, "gives a negative deadline", "refused `deadline`") {
  fresh();
  REFUSED(fuseline_shared_offer(machine, 0, message_id, 1, (uint64_t)-20, 0, &fired, &a), FUSELINE_REASON_DEADLINE);
  REFUSED(fuseline_shared_open_within(machine, 0, 2, (uint64_t)-20, &message_id, &a), FUSELINE_REASON_DEADLINE);
}
CASE(shared_no_greatest_deadline, "sets no greatest deadline", "status `deadline`") {
  fuseline_config config = valid();
  config.greatest_deadline = 0;
  HOLDS(fuseline_shared_init(&storage, sizeof storage, &config, &machine) == FUSELINE_STATUS_DEADLINE);
}
CASE(shared_other_shape, "requests a shape that the library lacks", "status `capacity`") {
  static FUSELINE_SHARED_STORAGE(15, 60) large;
  fuseline_config config = valid();
  config.capacity = FUSELINE_CAPACITY_OF(15, 40);
  HOLDS(fuseline_shared_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_CAPACITY);
  config.capacity = fuseline_own_capacity();
  HOLDS(fuseline_shared_init(&large, sizeof large, &config, &machine) == FUSELINE_STATUS_DONE);
  IS(fuseline_shared_open(machine, 0, 1, &message_id, &a), FUSELINE_OUTCOME_ACCEPTED);
  IS(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a), FUSELINE_OUTCOME_FORWARDED);
}
CASE(shared_window_range, "gives a window of 0, or above the capacity", "status `window`") {
  fuseline_config config = valid();
  config.window = 0;
  HOLDS(fuseline_shared_init(&storage, sizeof storage, &config, &machine) == FUSELINE_STATUS_WINDOW);
  config.window = 17;
  HOLDS(fuseline_shared_init(&storage, sizeof storage, &config, &machine) == FUSELINE_STATUS_WINDOW);
}
CASE(shared_capacity_overwritten, "overwrites the capacity in the head of the storage", "status `foreign`") {
  fresh();
  storage.opaque[2] = 0;
  HOLDS(fuseline_shared_open(machine, 0, 2, &message_id, &a) == FUSELINE_STATUS_FOREIGN);
  HOLDS(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a) == FUSELINE_STATUS_FOREIGN);
}
CASE(shared_misaligned_storage, "aligns storage to 8 bytes instead of 64", "status `alignment`") {
  const fuseline_config config = valid();
  HOLDS(fuseline_shared_init(&storage.opaque[1], sizeof storage - 8U, &config, &machine) == FUSELINE_STATUS_ALIGNMENT);
}
CASE(shared_as_plain, "passes a machine to functions of the other kind", "status `foreign`") {
  fresh();
  HOLDS(fuseline_open((fuseline_machine *)(void *)machine, 0, 2, &a) == FUSELINE_STATUS_FOREIGN);
}
CASE(shared_copied, "uses a copy of a machine's bytes", "status `foreign`") {
  fresh();
  other = storage;
  HOLDS(fuseline_shared_open((fuseline_shared *)(void *)&other, 0, 2, &message_id, &a) == FUSELINE_STATUS_FOREIGN);
}
CASE(shared_ended_twice, "ends a machine twice", "status `foreign`") {
  fresh();
  HOLDS(fuseline_shared_end(machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_shared_end(machine) == FUSELINE_STATUS_FOREIGN);
}
CASE(shared_no_message_id, "uses a message id of zeros", "status `message_id`") {
  const fuseline_message_id none = {{0, 0, 0}};
  uint64_t due = 0;
  fresh();
  HOLDS(fuseline_shared_result(machine, 0, none, 0, &fired, &a) == FUSELINE_STATUS_MESSAGE_ID);
  HOLDS(fuseline_shared_offer(machine, 0, none, 1, 1, 0, &fired, &a) == FUSELINE_STATUS_MESSAGE_ID);
  HOLDS(fuseline_shared_next_due(machine, none, &due) == FUSELINE_STATUS_MESSAGE_ID);
}
CASE(shared_message_id_of_another, "uses a message id of another machine", "status `message_id`") {
  static storage_type second;
  const fuseline_config config = valid();
  fuseline_shared *another;
  fresh();
  HOLDS(fuseline_shared_init(&second, sizeof second, &config, &another) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_shared_open(another, 0, 1, &message_id, &a) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a) == FUSELINE_STATUS_MESSAGE_ID);
  HOLDS(fuseline_shared_fail(machine, 0, message_id, 0, &fired, &a) == FUSELINE_STATUS_MESSAGE_ID);
  IS(fuseline_shared_result(another, 0, message_id, 0, &fired, &a), FUSELINE_OUTCOME_FORWARDED);
}
CASE(shared_refused_and_used, "uses the message id of a refused open, written over an earlier one", "status `message_id`: not taken for the earlier message") {
  fresh();
  REFUSED(fuseline_shared_open(machine, 0, 1, &message_id, &a), FUSELINE_REASON_ORDER);
  HOLDS(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a) == FUSELINE_STATUS_MESSAGE_ID);
}
CASE(shared_old_message_id, "uses the message id of a retired message", "dropped `superseded`") {
  fresh();
  IS(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a), FUSELINE_OUTCOME_FORWARDED);
  DROPPED(fuseline_shared_result(machine, 0, message_id, 0, &fired, &a), FUSELINE_REASON_SUPERSEDED);
}
CASE(shared_null_message_id, "passes a null message id", "status `null`; nothing is opened") {
  fresh();
  HOLDS(fuseline_shared_open(machine, 0, 2, NULL, &a) == FUSELINE_STATUS_NULL);
  IS(fuseline_shared_open(machine, 0, 2, &message_id, &a), FUSELINE_OUTCOME_ACCEPTED);
}
/* Both answers in one object, or in two that share their last and first bytes, in each function that has two. */
static void one_place_is_refused(fuseline_answer *first, fuseline_answer *second) {
  uint64_t due = 0;
  fresh();
  IS(fuseline_shared_offer(machine, 0, message_id, 1, 100, 0, &fired, &a), FUSELINE_OUTCOME_ADMITTED);
  IS(fuseline_shared_result(machine, 10, message_id, 0, &fired, &a), FUSELINE_OUTCOME_HELD);
  HOLDS(fuseline_shared_result(machine, 150, message_id, 1, first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_fail(machine, 150, message_id, 1, first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_expire(machine, 150, message_id, first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_offer(machine, 150, message_id, 2, 10, 0, first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_open(machine, 150, 2, (fuseline_message_id *)(void *)first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_open_within(machine, 150, 2, 10, (fuseline_message_id *)(void *)first, second) == FUSELINE_STATUS_OVERLAP);
  HOLDS(fuseline_shared_next_due(machine, message_id, &due) == FUSELINE_STATUS_DONE && due == 100);
  HOLDS(fuseline_shared_expire(machine, 150, message_id, &fired, &a) == FUSELINE_STATUS_DONE);
  HOLDS(fired.outcome == FUSELINE_OUTCOME_FORWARDED && fired.by == 0);
}
CASE(shared_one_answer_for_two, "passes one object as both answers", "status `overlap`; the forward is still to come") {
  one_place_is_refused(&a, &a);
}
CASE(shared_answers_overlap, "passes two answers that share bytes", "status `overlap`; the forward is still to come") {
  static uint64_t room[sizeof(fuseline_answer) / 4];
  one_place_is_refused((fuseline_answer *)(void *)room, (fuseline_answer *)(void *)&room[1]);
  one_place_is_refused((fuseline_answer *)(void *)&room[1], (fuseline_answer *)(void *)room);
}

int main(int argc, char **argv) { return run_cases(argc > 1 ? argv[1] : NULL); }
