/*
 * The same for the machine for many threads, called by one thread: two machines get the same calls, one of them is misused
 * in between. Also message ids that are old, and message ids that no machine or the other one gave: both machines answer alike, as of nothing open.
 */
#include "fuzz.h"

enum { TICKETS = 8 };
typedef FUSELINE_SHARED_STORAGE(3, 16) storage_type;

static storage_type misused, clean, other;
static fuseline_shared *machine, *twin;
static fuseline_message_id message_ids[TICKETS], twins[TICKETS];
static unsigned opened;

static fuseline_status call(fuseline_shared *m, unsigned kind, const uint64_t *n, fuseline_message_id *message_id, fuseline_answer *fired,
                            fuseline_answer *a) {
  switch (kind % 6U) {
    case 0: return fuseline_shared_open(m, n[0], n[1], message_id, a);
    case 1: return fuseline_shared_open_within(m, n[0], n[1], n[2], message_id, a);
    case 2: return fuseline_shared_offer(m, n[0], *message_id, n[2] % 5U, n[3], n[3] % 6U, fired, a);
    case 3: return fuseline_shared_result(m, n[0], *message_id, n[2] % 5U, fired, a);
    case 4: return fuseline_shared_fail(m, n[0], *message_id, n[2] % 5U, fired, a);
    default: return fuseline_shared_expire(m, n[0], *message_id, fired, a);
  }
}

static void both(void) {
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

static void wrong_call(void) {
  static union {
    fuseline_answer answer;
    uint8_t raw[sizeof(fuseline_answer) + 8];
  } place, before;
  const uint64_t n[4] = {UINT64_MAX, UINT64_MAX - 1U, 1, 1};
  unsigned kind = byte();
  fuseline_shared *m = machine;
  fuseline_answer fired, *a = &place.answer;
  fuseline_message_id message_id = message_ids[byte() % TICKETS];
  fuseline_status expected = FUSELINE_STATUS_FOREIGN;
  storage_type was = misused;
  memset(&place, 0x33, sizeof place);
  before = place;
  switch (byte() % 8U) {
    case 0: m = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 1: a = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 2: a = (fuseline_answer *)(void *)(place.raw + 1U + byte() % 7U); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 3: m = (fuseline_shared *)(void *)((uint8_t *)&misused + 1U + byte() % 63U); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 4: memcpy(&other, &misused, sizeof other); m = (fuseline_shared *)(void *)&other; break;
    case 5: memset(&other, (int)byte(), sizeof other); m = (fuseline_shared *)(void *)&other; break;
    case 6: m = (fuseline_shared *)(void *)((uint8_t *)&misused + 64U * (1U + byte() % 20U)); break;
    default:
      a = (fuseline_answer *)(void *)((uint8_t *)&misused + 8U * (byte() % (fuseline_shared_bytes(FUSELINE_CAPACITY_C3W16) / 8U)));
      expected = FUSELINE_STATUS_OVERLAP;
      break;
  }
  ++wrong_uses;
  HOLDS(call(m, kind, n, &message_id, &fired, a) == expected);
  HOLDS(memcmp(&place, &before, sizeof place) == 0);
  HOLDS(same(&was, &misused, sizeof was));
}

static void wrong_init(void) {
  fuseline_config config = valid(0);
  fuseline_shared *made = NULL;
  size_t size = sizeof other;
  fuseline_status expected = spoil(&config, &size, fuseline_shared_bytes(FUSELINE_CAPACITY_C3W16));
  storage_type was;
  memset(&other, 0x44, sizeof other);
  was = other;
  ++wrong_uses;
  HOLDS(fuseline_shared_init(&other, size, &config, &made) == expected);
  HOLDS(made == NULL);
  HOLDS(same(&was, &other, sizeof was));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  fuseline_config config;
  bytes = data;
  left = size;
  opened = 0;
  memset(message_ids, 0, sizeof message_ids);
  memset(twins, 0, sizeof twins);
  config = valid(byte());
  HOLDS(fuseline_shared_init(&misused, sizeof misused, &config, &machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_shared_init(&clean, sizeof clean, &config, &twin) == FUSELINE_STATUS_DONE);
  while (left > 0) {
    switch (byte() % 8U) {
      case 0: wrong_call(); break;
      case 1: wrong_init(); break;
      default: both(); break;
    }
  }
  HOLDS(fuseline_shared_end(machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_shared_end(machine) == FUSELINE_STATUS_FOREIGN);
  HOLDS(fuseline_shared_end(twin) == FUSELINE_STATUS_DONE);
  return 0;
}
