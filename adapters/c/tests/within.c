/*
 * A call from within another, by a signal that interrupts it: it gets FUSELINE_STATUS_BUSY and changes nothing.
 *
 * A timer interrupts the inputs of the main program until enough calls were caught in the midst of another. Each handler
 * ticks the same machine; what it gets must be busy or done. While it is busy, it cannot be ended either. At the end the
 * machine answers as one that was never interrupted. The owner's half of a machine for many threads does the same.
 */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/time.h>

#include "fuseline.h"

enum { ENOUGH = 20, MOST = 400000000 };

static fuseline_storage_c3w16 storage, calm_storage;
static fuseline_machine *machine, *calm;
static FUSELINE_SHARED_STORAGE(3, 16) shared_storage;
static fuseline_shared *shared;
static volatile sig_atomic_t busy, done, shared_busy, wrong;

static void interrupted(int signal) {
  fuseline_answer a, before;
  fuseline_message_id id;
  fuseline_status status;
  (void)signal;
  memset(&a, 0x5a, sizeof a);
  before = a;
  status = fuseline_tick(machine, 0, &a);
  if (status == FUSELINE_STATUS_BUSY) {
    if (memcmp(&a, &before, sizeof a) != 0 || fuseline_end(machine) != FUSELINE_STATUS_BUSY) wrong = 1;
    ++busy;
  } else if (status == FUSELINE_STATUS_DONE) {
    ++done;
  } else {
    wrong = 1;
  }
  /* Refused `order`, unless a call is under way. */
  status = fuseline_shared_open(shared, 1, 0, &id, &a);
  if (status == FUSELINE_STATUS_BUSY) {
    ++shared_busy;
  } else if (status != FUSELINE_STATUS_DONE || a.why != FUSELINE_REASON_ORDER) {
    wrong = 1;
  }
}
static int same_shared(uint64_t i) {
  fuseline_answer fired, a;
  fuseline_message_id id;
  if (fuseline_shared_open(shared, 1, i, &id, &a) != FUSELINE_STATUS_DONE || a.outcome != FUSELINE_OUTCOME_ACCEPTED) return 0;
  return fuseline_shared_result(shared, 1, id, 0, &fired, &a) == FUSELINE_STATUS_DONE && a.outcome == FUSELINE_OUTCOME_FORWARDED;
}

/* All at one instant, so that the handler's ticks decide nothing. */
static int same(uint64_t i) {
  fuseline_answer a, b;
  fuseline_status x, y;
  memset(&a, 0, sizeof a);
  memset(&b, 0, sizeof b);
  switch (i % 3U) {
    case 0: x = fuseline_open(machine, 1, i, &a), y = fuseline_open(calm, 1, i, &b); break;
    case 1: x = fuseline_offer(machine, 1, i - 1U, 1, 50, 0, &a), y = fuseline_offer(calm, 1, i - 1U, 1, 50, 0, &b); break;
    default: x = fuseline_result(machine, 1, i - 2U, 1, &a), y = fuseline_result(calm, 1, i - 2U, 1, &b); break;
  }
  return x == FUSELINE_STATUS_DONE && y == x && memcmp(&a, &b, sizeof a) == 0;
}

int main(void) {
  const fuseline_cloud clouds[] = {{1, 31, 30}};
  const fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C3W16, FUSELINE_COMMIT_EAGER, 16, 1, clouds, 1000};
  const struct itimerval every = {{0, 50}, {0, 50}};
  struct sigaction action;
  uint64_t i;
  if (fuseline_init(&storage, sizeof storage, &config, &machine) != FUSELINE_STATUS_DONE) return 1;
  if (fuseline_init(&calm_storage, sizeof calm_storage, &config, &calm) != FUSELINE_STATUS_DONE) return 1;
  if (fuseline_shared_init(&shared_storage, sizeof shared_storage, &config, &shared) != FUSELINE_STATUS_DONE || !same_shared(0)) return 1;
  memset(&action, 0, sizeof action);
  action.sa_handler = interrupted;
  action.sa_flags = SA_RESTART;
  if (sigaction(SIGALRM, &action, NULL) != 0 || setitimer(ITIMER_REAL, &every, NULL) != 0) return 1;
  for (i = 0; i < (uint64_t)MOST && (busy < ENOUGH || done < ENOUGH || shared_busy < ENOUGH) && !wrong; ++i) {
    if (!same(i) || !same_shared(i + 1U)) wrong = 1;
  }
  printf("%llu inputs, interrupted %d times within a call and %d times between two\n", (unsigned long long)i, (int)busy, (int)done);
  return wrong || busy < ENOUGH || done < ENOUGH || shared_busy < ENOUGH;
}
