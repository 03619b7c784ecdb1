/* The machine for one thread. */
#include "fuseline.h"

typedef fuseline_machine machine_type;
typedef fuseline_storage_c3w16 storage_type;
#define ALIGNMENT 8U
#define OF(function) fuseline_##function
#include "fuzz.h"

static fuseline_status input(machine_type *m, unsigned kind, const uint64_t *n, fuseline_answer *a) {
  switch (kind % 6U) {
    case 0: return fuseline_open(m, n[0], n[1], a);
    case 1: return fuseline_open_within(m, n[0], n[1], n[2], a);
    case 2: return fuseline_offer(m, n[0], n[1], n[2] % 5U, n[3], n[3] % 6U, a);
    case 3: return fuseline_result(m, n[0], n[1], n[2] % 5U, a);
    case 4: return fuseline_fail(m, n[0], n[1], n[2] % 5U, a);
    default: return fuseline_tick(m, n[0], a);
  }
}

/* The same input to both, until it is done. */
static void both(void) {
  unsigned kind = byte(), rounds = 0;
  uint64_t n[4];
  fuseline_answer a, b;
  fuseline_status status;
  unsigned i;
  for (i = 0; i < 4U; ++i) n[i] = number();
  ++inputs;
  do {
    memset(&a, 0x11, sizeof a);
    memset(&b, 0x22, sizeof b);
    status = input(machine, kind, n, &a);
    HOLDS(status == input(twin, kind, n, &b));
    HOLDS(status == FUSELINE_STATUS_DONE || status == FUSELINE_STATUS_AGAIN);
    HOLDS(memcmp(&a, &b, sizeof a) == 0);
    HOLDS((status == FUSELINE_STATUS_AGAIN) == (a.fired == 1U));
    HOLDS(++rounds <= 4U * 16U + 1U);
  } while (status == FUSELINE_STATUS_AGAIN);
}

static void questions(void) {
  fuseline_state a, b;
  fuseline_message c, d;
  uint64_t t = number();
  memset(&c, 0, sizeof c);
  memset(&d, 0, sizeof d);
  HOLDS(fuseline_look(machine, &a) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_look(twin, &b) == FUSELINE_STATUS_DONE);
  HOLDS(memcmp(&a, &b, sizeof a) == 0);
  HOLDS(fuseline_look_at(machine, t, &c) == fuseline_look_at(twin, t, &d));
  HOLDS(memcmp(&c, &d, sizeof c) == 0);
  HOLDS(strlen(fuseline_status_name(byte())) > 0U && strlen(fuseline_outcome_name(byte())) > 0U);
  HOLDS(strlen(fuseline_reason_name((uint32_t)number())) > 0U);
}

static void right_call(void) {
  if (byte() % 6U == 0U) {
    questions();
  } else {
    both();
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  fuzz(data, size);
  return 0;
}
