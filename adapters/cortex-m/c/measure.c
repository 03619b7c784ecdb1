/*
 * Measures what a machine of one capacity costs on a Cortex-M: the most instructions of each input, and the deepest
 * stack, on inputs chosen to be expensive: a window kept nearly full and touched anywhere, with dues that now and then
 * coincide.
 *
 * QEMU counts: with -icount shift=7 each instruction takes 128 ns of its clock, on which SysTick counts at 25 MHz. What
 * a measurement itself takes, the call and its arguments included, is taken off.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "fuseline.h"

#define SYST_CSR (*(volatile uint32_t *)0xE000E010U)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014U)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018U)

enum { PAINT = 0x5a, DEEPEST = WINDOW * 600 + 4096 };

static FUSELINE_STORAGE(CLOUDS, WINDOW) storage;
static fuseline_machine *machine;
static uint64_t open_ts[WINDOW];
static unsigned open_len;

enum kind { OPEN, OFFER, RESULT, FAIL, TICK, FIRING, NEXT_DUE, KINDS };
static const char *const words[KINDS] = {"open", "offer", "result", "fail", "tick", "firing", "next due"};
static uint32_t most[KINDS], calls[KINDS];
static uint32_t nothing;

/* Steele and Vigna's SplitMix64. */
static uint64_t state = 1;
static uint32_t below(uint32_t bound) {
  uint64_t z;
  state += 0x9e3779b97f4a7c15U;
  z = (state ^ (state >> 30)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
  return (uint32_t)(((z ^ (z >> 31)) >> 32) % bound);
}

static fuseline_status input(enum kind kind, uint64_t now, const uint64_t *n, fuseline_answer *a) {
  switch (kind) {
    case OPEN: return n[1] > 0U ? fuseline_open_within(machine, now, n[0], n[1], a) : fuseline_open(machine, now, n[0], a);
    case OFFER: return fuseline_offer(machine, now, n[0], n[1], n[2], 0, a);
    case RESULT: return fuseline_result(machine, now, n[0], n[1], a);
    case FAIL: return fuseline_fail(machine, now, n[0], n[1], a);
    case TICK: return fuseline_tick(machine, now, a);
    case NEXT_DUE: return fuseline_next_due(machine, &a->due);
    default: return FUSELINE_STATUS_DONE; /* nothing at all */
  }
}

static uint32_t count(enum kind kind, uint64_t now, const uint64_t *n, fuseline_answer *a, fuseline_status *status) {
  uint32_t begin = SYST_CVR;
  uint32_t end;
  *status = input(kind, now, n, a);
  end = SYST_CVR;
  return (((begin - end) & 0xffffffU) * 40U + 64U) / 128U;
}

static void retired(uint64_t t) {
  unsigned i;
  for (i = 0; i < open_len && open_ts[i] != t; ++i) {
  }
  if (i < open_len) {
    --open_len;
    memmove(&open_ts[i], &open_ts[i + 1U], (open_len - i) * sizeof open_ts[0]);
  }
}

/* One input and the firings before it. */
static fuseline_answer submit(enum kind kind, uint64_t now, uint64_t t, uint64_t x, uint64_t y) {
  const uint64_t n[3] = {t, x, y};
  fuseline_answer a;
  fuseline_status status;
  enum kind was;
  do {
    uint32_t took = count(kind, now, n, &a, &status) - nothing;
    was = status == FUSELINE_STATUS_AGAIN ? FIRING : kind;
    ++calls[was];
    if (took > most[was]) most[was] = took;
    if (a.outcome == FUSELINE_OUTCOME_FORWARDED || a.outcome == FUSELINE_OUTCOME_FINAL || a.outcome == FUSELINE_OUTCOME_MISSED) {
      retired(a.t);
    }
  } while (was == FIRING);
  return a;
}

static void inputs(uint32_t commit, unsigned rounds) {
  fuseline_cloud clouds[CLOUDS];
  fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY, commit, WINDOW, CLOUDS, clouds, UINT64_MAX};
  uint64_t now = 0, newest = 0;
  unsigned i, round;
  fuseline_answer ignored;
  const uint64_t none[3] = {0, 0, 0};
  fuseline_status status;
  for (i = 0; i < CLOUDS; ++i) {
    clouds[i].priority = i + 1U;
    clouds[i].limit = 31;
    clouds[i].resume = 30;
  }
  if (fuseline_init(&storage, sizeof storage, &config, &machine) != FUSELINE_STATUS_DONE) return;
  open_len = 0;
  for (round = 0; round < rounds; ++round) {
    uint64_t t;
    uint32_t due;
    if (open_len < WINDOW - below(WINDOW < 3 ? 1 : 3)) {
      fuseline_answer a;
      newest += 1U + below(5);
      a = submit(OPEN, now, newest, below(2) == 0U ? 1U + below(WINDOW * 3U) : 0U, 0);
      if (a.outcome == FUSELINE_OUTCOME_ACCEPTED) open_ts[open_len++] = newest;
    }
    t = open_len > 0U ? open_ts[below(open_len)] : newest;
    switch (below(4)) {
      case 0:
      case 1: submit(OFFER, now, t, 1U + below(CLOUDS), 1U + below(WINDOW * 4U)); break;
      case 2: submit(RESULT, now, t, below(CLOUDS + 1U), 0); break;
      default: submit(FAIL, now, t, below(CLOUDS + 1U), 0); break;
    }
    if (below(4) == 0U) {
      now += below(10);
      submit(TICK, now, 0, 0, 0);
    }
    memset(&ignored, 0, sizeof ignored);
    due = count(NEXT_DUE, 0, none, &ignored, &status) - nothing;
    if (due > most[NEXT_DUE]) most[NEXT_DUE] = due;
    ++calls[NEXT_DUE];
  }
}

static uint32_t used(volatile uint8_t *lowest, volatile uint8_t *top) {
  volatile uint8_t *at = lowest;
  while (at < top && *at == PAINT) ++at;
  return (uint32_t)(top - at);
}

/* Runs it on a painted stack and says how deep it went. */
__attribute__((noinline)) static uint32_t deepest(void (*run)(void)) {
  volatile uint8_t *top;
  volatile uint8_t *at;
  __asm__ volatile("mov %0, sp" : "=r"(top));
  for (at = top - DEEPEST; at < top; ++at) *at = PAINT;
  run();
  return used(top - DEEPEST, top);
}

static fuseline_config of_stack;
static void one_init(void) { (void)!fuseline_init(&storage, sizeof storage, &of_stack, &machine); }
static void idle(void) {}
static fuseline_answer of_inputs;
static enum kind one_kind;
static uint64_t one_input[3];
static uint64_t one_now;
static void one(void) { (void)!input(one_kind, one_now, one_input, &of_inputs); }

/* The deepest of some inputs of each kind, around a full window. */
static uint32_t stack_of_inputs(void) {
  uint32_t base = deepest(idle), worst = 0, i;
  uint64_t newest = 100000000U;
  (void)!fuseline_init(&storage, sizeof storage, &of_stack, &machine);
  for (i = 0; i < DEPTHS; ++i) {
    uint32_t depth;
    one_kind = (enum kind)below(TICK + 1U);
    one_input[0] = one_kind == OPEN ? ++newest : newest - below(WINDOW);
    one_input[1] = one_kind == OPEN ? 1U + below(100) : below(CLOUDS + 1U);
    one_input[2] = 1U + below(50);
    one_now += below(8);
    depth = deepest(one) - base;
    if (depth > worst) worst = depth;
  }
  return worst;
}

int main(void) {
  const uint64_t n[3] = {0, 0, 0};
  fuseline_answer a;
  fuseline_status status;
  unsigned i;
  SYST_RVR = 0xffffffU;
  SYST_CVR = 0;
  SYST_CSR = 5;
  nothing = count(KINDS, 0, n, &a, &status);
  inputs(FUSELINE_COMMIT_EAGER, ROUNDS);
  inputs(FUSELINE_COMMIT_PATIENT, ROUNDS);
  inputs(FUSELINE_COMMIT_PROGRESSIVE, ROUNDS);
  printf("clouds %d window %d bytes %lu", CLOUDS, WINDOW, (unsigned long)fuseline_bytes(FUSELINE_CAPACITY));
  for (i = 0; i < KINDS; ++i) printf(" %s %lu/%lu", words[i], (unsigned long)most[i], (unsigned long)calls[i]);
  of_stack = (fuseline_config){FUSELINE_CONFIG, FUSELINE_CAPACITY, FUSELINE_COMMIT_EAGER, WINDOW, CLOUDS, NULL, UINT64_MAX};
  {
    static fuseline_cloud clouds[CLOUDS];
    for (i = 0; i < CLOUDS; ++i) clouds[i] = (fuseline_cloud){i + 1U, 31, 30};
    of_stack.clouds = clouds;
  }
  printf(" stack-of-init %lu", (unsigned long)(deepest(one_init) - deepest(idle)));
  printf(" stack %lu\n", (unsigned long)stack_of_inputs());
  return 0;
}
