/*
 * Shared by the fuzz targets of both kinds of machine: bytes that decide, configurations right and wrong, and a main for
 * valgrind and gcc, which makes its own bytes (-DWITHOUT_LIBFUZZER; its argument says how many cases).
 */
#ifndef FUSELINE_TESTS_FUZZ_H
#define FUSELINE_TESTS_FUZZ_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

#define HOLDS(condition) \
  do { \
    if (!(condition)) { \
      fprintf(stderr, "line %d does not hold: %s\n", __LINE__, #condition); \
      abort(); \
    } \
  } while (0)

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
