/*
 * A driver over the C interface: it answers what `fuseline drive` asks, on a host and, over semihosting, on bare metal.
 *
 *     fuseline drive -- ./drive
 */
#include "fuseline.h"
#include "line.h"

static fuseline_storage_c15w1024 storage;
static fuseline_machine *machine;
static uint32_t commit;
static struct said said;

static void final_of(const fuseline_answer *a) {
  say_head(&said, "final", a->at, a->t);
  say_member(&said, "p", a->by);
  say_end(&said);
}

/* Writes the decisions that a firing or an input led to. */
static void conclude(const fuseline_answer *a, uint64_t p) {
  uint32_t i;
  switch (a->outcome) {
    case FUSELINE_OUTCOME_DROPPED:
      say_head(&said, "drop", a->at, a->t);
      say_member(&said, "p", p);
      say_why(&said, fuseline_reason_name(a->why));
      say_end(&said);
      break;
    case FUSELINE_OUTCOME_HELD:
      say_head(&said, "hold", a->at, a->t);
      say_member(&said, "p", p);
      say_end(&said);
      break;
    case FUSELINE_OUTCOME_MISSED:
      say_head(&said, "miss", a->at, a->t);
      say_end(&said);
      break;
    case FUSELINE_OUTCOME_FINAL:
      final_of(a);
      break;
    case FUSELINE_OUTCOME_PRELIMINARY:
    case FUSELINE_OUTCOME_FORWARDED:
      say_head(&said, "emit", a->at, a->t);
      say_member(&said, "p", a->by);
      say_end(&said);
      for (i = 0; i < a->cancelled_len; ++i) {
        say_head(&said, "cancel", a->at, a->t);
        say_member(&said, "p", a->cancelled[i]);
        say_end(&said);
      }
      if (commit == FUSELINE_COMMIT_PROGRESSIVE && a->outcome == FUSELINE_OUTCOME_FORWARDED) final_of(a);
      break;
    case FUSELINE_OUTCOME_ADMITTED:
      say_head(&said, "request", a->at, a->t);
      say_member(&said, "p", p);
      say_member(&said, "due", a->due);
      say_end(&said);
      break;
    default: /* waiting, accepted, nothing: no line; refused: by the caller, who knows of what */
      break;
  }
}

static void fired(const fuseline_answer *a) {
  uint32_t i;
  for (i = 0; i < a->timers_len; ++i) {
    say_head(&said, "timer", a->at, a->t);
    say_member(&said, "p", a->timers[i]);
    say_end(&said);
  }
  conclude(a, 0);
}

static void answered(const fuseline_answer *a, const struct line *line) {
  if (a->outcome == FUSELINE_OUTCOME_REFUSED) {
    say_head(&said, "refuse", a->at, a->t);
    if (line->kind == LINE_OFFER) say_member(&said, "p", line->p);
    say_why(&said, fuseline_reason_name(a->why));
    say_end(&said);
  } else {
    conclude(a, line->p);
  }
}

static fuseline_status start(const struct line *line) {
  fuseline_cloud clouds[LINE_CLOUDS];
  fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C15W1024, 0, 0, 0, NULL, UINT64_MAX};
  uint32_t i;
  for (i = 0; i < line->clouds_len; ++i) {
    clouds[i].priority = line->clouds[i].p;
    clouds[i].limit = line->clouds[i].limit;
    clouds[i].resume = line->clouds[i].resume;
  }
  commit = line->commit;
  config.commit = commit;
  config.window = line->window > 1024U ? 0U : (uint32_t)line->window;
  config.clouds_len = line->clouds_len;
  config.clouds = clouds;
  return fuseline_init(&storage, sizeof storage, &config, &machine);
}

static fuseline_status ask(const struct line *line, fuseline_answer *a) {
  switch (line->kind) {
    case LINE_OPEN:
      return line->has_deadline ? fuseline_open_within(machine, line->at, line->t, line->deadline, a)
                                : fuseline_open(machine, line->at, line->t, a);
    case LINE_OFFER:
      return fuseline_offer(machine, line->at, line->t, line->p, line->deadline, line->backlog, a);
    case LINE_RESULT:
      return fuseline_result(machine, line->at, line->t, line->p, a);
    case LINE_FAIL:
      return fuseline_fail(machine, line->at, line->t, line->p, a);
    default:
      return fuseline_tick(machine, line->at, a);
  }
}

/* 1 if the line was answered. */
static int reply(const char *text) {
  static struct line line;
  fuseline_answer a;
  fuseline_status status = FUSELINE_STATUS_DONE;
  if (!line_parse(text, &line)) return 0;
  if (line.kind == LINE_HEADER) {
    status = start(&line);
  } else {
    while ((status = ask(&line, &a)) == FUSELINE_STATUS_AGAIN) {
      fired(&a);
      if (said.len > sizeof said.text / 2U) say_now(&said);
    }
    if (status == FUSELINE_STATUS_DONE) answered(&a, &line);
  }
  return status == FUSELINE_STATUS_DONE;
}

int main(void) { return fuseline_abi() == FUSELINE_ABI ? serve(&said, reply) : 2; }
