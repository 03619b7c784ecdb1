/*
 * Fuzzing of the C interface with right and wrong use, mixed. Two machines get the same inputs; one of them is misused in
 * between. Each wrong call must be reported by its status, and must change neither the machine nor the answer. So the two
 * always answer the same.
 *
 * Both fuzz targets share this header. Before a target includes it, the target names its kind of machine: `machine_type`,
 * `storage_type`, its ALIGNMENT, and OF(function), which names a function of that kind.
 *
 * With libFuzzer: clang -fsanitize=fuzzer. With valgrind or gcc: -DWITHOUT_LIBFUZZER, for a main that makes its own bytes;
 * its argument says how many cases.
 */
#ifndef FUSELINE_TESTS_FUZZ_H
#define FUSELINE_TESTS_FUZZ_H

#include <string.h>

#include "../holds.h"
#include "fuseline.h"

/* Part of valgrind's package. */
#if defined(__has_include)
#if __has_include(<valgrind/memcheck.h>)
#include <valgrind/memcheck.h>
#endif
#endif
#ifndef VALGRIND_MAKE_MEM_DEFINED
#define VALGRIND_MAKE_MEM_DEFINED(at, len) ((void)(at), (void)(len))
#endif

static const uint8_t *bytes;
static size_t left;
static unsigned wrong_uses, inputs;

static unsigned byte(void) {
  if (left == 0) return 0;
  --left;
  return *bytes++;
}

/* Small numbers mostly, and the ends of the range. */
static uint64_t number(void) {
  unsigned b = byte();
  return b < 250U ? b % 40U : UINT64_MAX - (uint64_t)(b - 250U);
}

/* Returns whether all bytes are the same, also those between members, which nobody ever wrote. The copies let valgrind
 * take those for written. */
static int same(const void *a, const void *b, size_t len) {
  static uint8_t copies[2][8192];
  HOLDS(len <= sizeof copies[0]);
  memcpy(copies[0], a, len);
  memcpy(copies[1], b, len);
  (void)VALGRIND_MAKE_MEM_DEFINED(copies, sizeof copies);
  return memcmp(copies[0], copies[1], len) == 0;
}

static fuseline_cloud clouds[16];

static fuseline_config valid(unsigned commit) {
  fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C3W16, 0, 4, 3, clouds, UINT64_MAX};
  unsigned i;
  for (i = 0; i < 16U; ++i) {
    clouds[i].priority = i + 1U;
    clouds[i].limit = 4;
    clouds[i].resume = 2;
  }
  config.commit = commit % 3U;
  return config;
}

/* Makes a valid configuration, or the size of the storage, wrong, and gives the status that is due for it. */
static fuseline_status spoil(fuseline_config *config, size_t *size, size_t needed) {
  switch (byte() % 12U) {
    case 0: config->abi += 1U + byte(); return FUSELINE_STATUS_ABI;
    case 1: config->layout ^= 1U << (byte() % 32U); return FUSELINE_STATUS_ABI;
    case 2: config->capacity = 5U + byte(); return FUSELINE_STATUS_CAPACITY;
    case 3: config->commit = 3U + byte(); return FUSELINE_STATUS_COMMIT;
    case 4: config->window = byte() % 2U == 0U ? 0U : 17U + byte(); return FUSELINE_STATUS_WINDOW;
    case 5: config->clouds_len = 4U + byte(); return FUSELINE_STATUS_CLOUDS;
    case 6: clouds[byte() % 3U].priority = byte() % 2U == 0U ? 0U : 65536U + number() % 1000U; return FUSELINE_STATUS_PRIORITY;
    case 7: clouds[1].priority = clouds[byte() % 2U * 2U].priority; return FUSELINE_STATUS_TWICE;
    case 8: clouds[byte() % 3U].resume = 4U + number() % 1000U; return FUSELINE_STATUS_GATE;
    case 9: *size = byte() % needed; return FUSELINE_STATUS_SIZE;
    case 10: config->greatest_deadline = 0; return FUSELINE_STATUS_DEADLINE;
    default: config->clouds = NULL; return FUSELINE_STATUS_NULL;
  }
}

static storage_type misused, clean, other;
static machine_type *machine, *twin;

/* Gives an input of this kind to a machine. */
static fuseline_status input(machine_type *m, unsigned kind, const uint64_t *n, fuseline_answer *a);
/* Makes the same right call of both machines, and compares what they answer. */
static void right_call(void);

/* A place in the storage of the machine that is misused. */
static machine_type *machine_at(size_t offset) { return (machine_type *)(void *)((uint8_t *)&misused + offset); }

static void wrong_call(void) {
  static union {
    fuseline_answer answer;
    uint8_t raw[sizeof(fuseline_answer) + 8];
  } place, before;
  const uint64_t n[4] = {UINT64_MAX, number(), 1, 1};
  unsigned kind = byte();
  machine_type *m = machine;
  fuseline_answer *a = &place.answer;
  fuseline_status expected = FUSELINE_STATUS_FOREIGN;
  storage_type was = misused;
  memset(&place, 0x33, sizeof place);
  before = place;
  switch (byte() % 8U) {
    case 0: m = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 1: a = NULL; expected = FUSELINE_STATUS_NULL; break;
    case 2: a = (fuseline_answer *)(void *)(place.raw + 1U + byte() % 7U); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 3: m = machine_at(1U + byte() % (ALIGNMENT - 1U)); expected = FUSELINE_STATUS_ALIGNMENT; break;
    case 4: memcpy(&other, &misused, sizeof other); m = (machine_type *)(void *)&other; break;
    case 5: memset(&other, (int)byte(), sizeof other); m = (machine_type *)(void *)&other; break;
    case 6: m = machine_at(ALIGNMENT * (1U + byte() % (sizeof misused / ALIGNMENT - 1U))); break;
    default:
      a = (fuseline_answer *)(void *)machine_at(8U * (byte() % (OF(bytes)(FUSELINE_CAPACITY_C3W16) / 8U)));
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
  machine_type *made = NULL;
  size_t size = sizeof other;
  fuseline_status expected = spoil(&config, &size, OF(bytes)(FUSELINE_CAPACITY_C3W16));
  storage_type was;
  memset(&other, 0x44, sizeof other);
  was = other;
  ++wrong_uses;
  HOLDS(OF(init)(&other, size, &config, &made) == expected);
  HOLDS(made == NULL);
  HOLDS(same(&was, &other, sizeof was));
}

/* Uses new machines as the bytes decide. */
static void fuzz(const uint8_t *data, size_t size) {
  fuseline_config config;
  bytes = data;
  left = size;
  config = valid(byte());
  HOLDS(OF(init)(&misused, sizeof misused, &config, &machine) == FUSELINE_STATUS_DONE);
  HOLDS(OF(init)(&clean, sizeof clean, &config, &twin) == FUSELINE_STATUS_DONE);
  while (left > 0) {
    switch (byte() % 8U) {
      case 0: wrong_call(); break;
      case 1: wrong_init(); break;
      default: right_call(); break;
    }
  }
  HOLDS(OF(end)(machine) == FUSELINE_STATUS_DONE);
  HOLDS(OF(end)(machine) == FUSELINE_STATUS_FOREIGN);
  HOLDS(OF(end)(twin) == FUSELINE_STATUS_DONE);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#ifdef WITHOUT_LIBFUZZER
int main(int argc, char **argv) {
  static uint8_t data[512];
  uint64_t state = 1;
  long cases = argc > 1 ? strtol(argv[1], NULL, 10) : 1000;
  for (long i = 0; i < cases; ++i) {
    for (size_t k = 0; k < sizeof data; ++k) {
      state = state * 6364136223846793005U + 1442695040888963407U;
      data[k] = (uint8_t)(state >> 56);
    }
    LLVMFuzzerTestOneInput(data, sizeof data);
  }
  printf("%ld cases: %u inputs to both machines, %u wrong uses reported\n", cases, inputs, wrong_uses);
  return wrong_uses > 0U && inputs > 0U ? 0 : 1;
}
#endif

#endif /* FUSELINE_TESTS_FUZZ_H */
