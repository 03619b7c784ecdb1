/*
 * The machine for many threads, called by one thread. Also message ids that are old, and message ids that no machine or
 * the other one gave: both machines give the same answer, as if nothing were open.
 */
#include "fuseline.h"

typedef fuseline_shared machine_type;
typedef FUSELINE_SHARED_STORAGE(3, 16) storage_type;
#define ALIGNMENT 64U
#define OF(function) fuseline_shared_##function
#include "fuzz.h"

enum { TICKETS = 8 };
static fuseline_message_id message_ids[TICKETS], twins[TICKETS];
static unsigned opened;

static fuseline_status call(machine_type *m, unsigned kind, const uint64_t *n, fuseline_message_id *message_id,
                            fuseline_answer *fired, fuseline_answer *a) {
  switch (kind % 6U) {
    case 0: return fuseline_shared_open(m, n[0], n[1], message_id, a);
    case 1: return fuseline_shared_open_within(m, n[0], n[1], n[2], message_id, a);
    case 2: return fuseline_shared_offer(m, n[0], *message_id, n[2] % 5U, n[3], n[3] % 6U, fired, a);
    case 3: return fuseline_shared_result(m, n[0], *message_id, n[2] % 5U, fired, a);
    case 4: return fuseline_shared_fail(m, n[0], *message_id, n[2] % 5U, fired, a);
    default: return fuseline_shared_expire(m, n[0], *message_id, fired, a);
  }
}

static fuseline_status input(machine_type *m, unsigned kind, const uint64_t *n, fuseline_answer *a) {
  fuseline_message_id message_id = message_ids[byte() % TICKETS];
  fuseline_answer fired;
  return call(m, kind, n, &message_id, &fired, a);
}

static void right_call(void) {
  unsigned kind = byte(), i;
  uint64_t n[4], due = 0, its_due = 0;
  fuseline_answer a[2], b[2];
  fuseline_status status;
  const unsigned which = byte() % TICKETS;
  fuseline_message_id mine = message_ids[which], its = twins[which];
  for (i = 0; i < 4U; ++i) n[i] = number();
  if (byte() % 8U == 0U) {
    const unsigned word = byte() % 3U;
    const uint64_t bit = (uint64_t)1 << (byte() % 64U);
    mine.opaque[word] ^= bit;
    its.opaque[word] ^= bit;
  }
  memset(a, 0x11, sizeof a);
  memset(b, 0x11, sizeof b);
  ++inputs;
  status = call(machine, kind, n, &mine, &a[0], &a[1]);
  HOLDS(status == FUSELINE_STATUS_DONE || (status == FUSELINE_STATUS_MESSAGE_ID && kind % 6U >= 2U));
  HOLDS(call(twin, kind, n, &its, &b[0], &b[1]) == status);
  HOLDS(memcmp(a, b, sizeof a) == 0);
  HOLDS(mine.opaque[0] == its.opaque[0] && mine.opaque[1] == its.opaque[1]);
  /* The one's message id names nothing to the other. */
  HOLDS(call(twin, 5U, n, &mine, &b[0], &b[1]) == FUSELINE_STATUS_MESSAGE_ID);
  if (kind % 6U < 2U && a[1].outcome == FUSELINE_OUTCOME_ACCEPTED) {
    twins[opened % TICKETS] = its;
    message_ids[opened++ % TICKETS] = mine;
  }
  HOLDS(fuseline_shared_next_due(machine, mine, &due) == fuseline_shared_next_due(twin, its, &its_due));
  HOLDS(due == its_due);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  opened = 0;
  memset(message_ids, 0, sizeof message_ids);
  memset(twins, 0, sizeof twins);
  fuzz(data, size);
  return 0;
}
