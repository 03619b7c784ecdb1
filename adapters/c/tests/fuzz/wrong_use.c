/*
 * Fuzzing of the C interface with right and wrong use, mixed. Two machines get the same inputs; one of them is misused
 * in between. Each wrong call must be reported by its status, and must change neither the machine nor the answer: so the
 * two answer alike forever.
 *
 * With libFuzzer: clang -fsanitize=fuzzer. Without: -DWITHOUT_LIBFUZZER.
 */
#include "fuzz.h"

typedef fuseline_storage_c3w16 storage_type;

static storage_type misused, clean, other;
static fuseline_machine *machine, *twin;

static fuseline_status input(fuseline_machine *m, unsigned kind, const uint64_t *n, fuseline_answer *a) {
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

static void wrong_call(void) {
  static union {
    fuseline_answer answer;
    uint8_t raw[sizeof(fuseline_answer) + 8];
  } place, before;
  uint64_t n[4] = {UINT64_MAX, 1, 1, 1};
  unsigned kind = byte();
  fuseline_machine *m = machine;
  fuseline_answer *a = &place.answer;
  fuseline_status expected = FUSELINE_STATUS_FOREIGN;
  storage_type was = misused;
  memset(&place, 0x33, sizeof place);
  before = place;
  switch (byte() % 8U) {
    case 0: m = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 1: a = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 2: a = (fuseline_answer *)(void *)(place.raw + 1U + byte() % 7U); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 3: m = (fuseline_machine *)(void *)((uint8_t *)&misused + 1U + byte() % 7U); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 4: memcpy(&other, &misused, sizeof other); m = (fuseline_machine *)(void *)&other; break;
    case 5: memset(&other, (int)byte(), sizeof other); m = (fuseline_machine *)(void *)&other; break;
    case 6: m = (fuseline_machine *)(void *)((uint64_t *)&misused + 1U + byte()); break;
    default:
      a = (fuseline_answer *)(void *)((uint8_t *)&misused + 8U * (byte() % (fuseline_bytes(FUSELINE_CAPACITY_C3W16) / 8U)));
      expected = FUSELINE_STATUS_OVERLAP;
      break;
  }
  ++wrong_uses;
  HOLDS(input(m, kind, n, a) == expected);
  HOLDS(memcmp(&place, &before, sizeof place) == 0);
  HOLDS(same(&was, &misused, sizeof was));
}

static void wrong_init(void) {
  fuseline_config config = valid(0);
  fuseline_machine *made = NULL;
  size_t size = sizeof other;
  fuseline_status expected = spoil(&config, &size, fuseline_bytes(FUSELINE_CAPACITY_C3W16));
  storage_type was;
  memset(&other, 0x44, sizeof other);
  was = other;
  ++wrong_uses;
  HOLDS(fuseline_init(&other, size, &config, &made) == expected);
  HOLDS(made == NULL);
  HOLDS(same(&was, &other, sizeof was));
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

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  fuseline_config config;
  bytes = data;
  left = size;
  config = valid(byte());
  HOLDS(fuseline_init(&misused, sizeof misused, &config, &machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_init(&clean, sizeof clean, &config, &twin) == FUSELINE_STATUS_DONE);
  while (left > 0) {
    switch (byte() % 8U) {
      case 0: wrong_call(); break;
      case 1: wrong_init(); break;
      case 2: questions(); break;
      default: both(); break;
    }
  }
  HOLDS(fuseline_end(machine) == FUSELINE_STATUS_DONE);
  HOLDS(fuseline_end(machine) == FUSELINE_STATUS_FOREIGN);
  HOLDS(fuseline_end(twin) == FUSELINE_STATUS_DONE);
  return 0;
}
