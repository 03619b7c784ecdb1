/*
 * Shared by the drivers: a line of the trace (SPEC.md, section 6) read into plain data, text gathered to be written at
 * once, and the loop that reads lines and answers them. C99 and C++17, no allocation, no stdio.
 */
#ifndef FUSELINE_TESTS_LINE_H
#define FUSELINE_TESTS_LINE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

enum { LINE_LONGEST = 65536, LINE_CLOUDS = 15 };

enum line_kind { LINE_HEADER, LINE_OPEN, LINE_OFFER, LINE_RESULT, LINE_FAIL, LINE_TICK, LINE_NONE };

struct line_cloud {
  uint64_t p, limit, resume;
};

struct line {
  enum line_kind kind;
  uint64_t at, t, p, deadline, backlog, window;
  int has_deadline;
  uint32_t commit; /* as a fuseline_commit */
  unsigned clouds_len;
  struct line_cloud clouds[LINE_CLOUDS];
};

/* A place in the text; null once it was no JSON of the trace. */
typedef const char *cursor;

static inline cursor line_space(cursor c) { return c + strspn(c, " \t"); }

static inline cursor line_expect(cursor c, char wanted) {
  if (c == NULL) return NULL;
  c = line_space(c);
  return *c == wanted ? c + 1 : NULL;
}

static inline cursor line_number(cursor c, uint64_t *number) {
  if (c == NULL) return NULL;
  c = line_space(c);
  if (*c < '0' || *c > '9') return NULL;
  *number = 0;
  for (; *c >= '0' && *c <= '9'; ++c) *number = *number * 10U + (uint64_t)(unsigned char)(*c - '0');
  return c;
}

/* A string without its quotes; escapes stay as they are, for no word of the format has one. */
static inline cursor line_text(cursor c, char *text, size_t room) {
  size_t len = 0;
  c = line_expect(c, '"');
  if (c == NULL) return NULL;
  for (; *c != '"'; ++c) {
    if (*c == '\0') return NULL;
    if (len + 1U < room) text[len++] = *c;
    if (*c == '\\' && *++c == '\0') return NULL;
  }
  text[len] = '\0';
  return c + 1;
}

/* Any value at all, for `x` and names. */
static inline cursor line_skip(cursor c) {
  unsigned depth = 0;
  char ignored[2];
  do {
    c = line_space(c);
    if (*c == '"') {
      c = line_text(c, ignored, sizeof ignored);
      if (c == NULL) return NULL;
    } else if (*c == '{' || *c == '[') {
      ++depth;
      ++c;
    } else if (*c == '}' || *c == ']') {
      if (depth == 0) return NULL;
      --depth;
      ++c;
    } else if (*c == '\0') {
      return NULL;
    } else if (*c == ',' || *c == ':') {
      ++c;
    } else {
      c += strcspn(c, " \t,:{}[]\"");
    }
  } while (depth > 0U);
  return c;
}

static inline cursor line_one_cloud(cursor c, struct line *line) {
  struct line_cloud cloud = {0, 0, 0};
  int has_resume = 0;
  if (line->clouds_len >= (unsigned)LINE_CLOUDS) return NULL;
  c = line_expect(c, '{');
  while (c != NULL) {
    char key[12];
    c = line_expect(line_text(c, key, sizeof key), ':');
    if (c == NULL) return NULL;
    if (strcmp(key, "p") == 0) {
      c = line_number(c, &cloud.p);
    } else if (strcmp(key, "limit") == 0) {
      c = line_number(c, &cloud.limit);
    } else if (strcmp(key, "resume") == 0) {
      has_resume = 1;
      c = line_number(c, &cloud.resume);
    } else {
      c = line_skip(c);
    }
    if (c == NULL) return NULL;
    c = line_space(c);
    if (*c == '}') break;
    c = line_expect(c, ',');
  }
  if (c == NULL) return NULL;
  if (!has_resume && cloud.limit > 0U) cloud.resume = cloud.limit - 1U;
  line->clouds[line->clouds_len++] = cloud;
  return c + 1;
}

static inline cursor line_clouds(cursor c, struct line *line) {
  c = line_expect(c, '[');
  if (c == NULL) return NULL;
  c = line_space(c);
  while (c != NULL && *c != ']') {
    c = line_one_cloud(c, line);
    if (c == NULL) return NULL;
    c = line_space(c);
    if (*c == ',') ++c;
  }
  return c == NULL ? NULL : c + 1;
}

static inline enum line_kind line_event(const char *word) {
  static const char *const words[] = {"", "open", "offer", "result", "fail", "tick"};
  unsigned i;
  for (i = LINE_OPEN; i <= (unsigned)LINE_TICK; ++i) {
    if (strcmp(word, words[i]) == 0) return (enum line_kind)i;
  }
  return LINE_NONE;
}

/* Null if the word is no commit rule. */
static inline cursor line_commit(cursor c, uint32_t *commit) {
  static const char *const words[] = {"eager", "patient", "progressive"};
  char word[12] = "";
  c = line_text(c, word, sizeof word);
  for (*commit = 0; *commit < 3U; ++*commit) {
    if (strcmp(word, words[*commit]) == 0) return c;
  }
  return NULL;
}

static inline cursor line_member(cursor c, const char *key, struct line *line) {
  uint64_t version = 0;
  char word[12] = "";
  if (strcmp(key, "fuseline") == 0) {
    line->kind = LINE_HEADER;
    return line_number(c, &version);
  }
  if (strcmp(key, "ev") == 0) {
    c = line_text(c, word, sizeof word);
    line->kind = line_event(word);
    return c;
  }
  if (strcmp(key, "commit") == 0) return line_commit(c, &line->commit);
  if (strcmp(key, "deadline") == 0) {
    line->has_deadline = 1;
    return line_number(c, &line->deadline);
  }
  if (strcmp(key, "at") == 0) return line_number(c, &line->at);
  if (strcmp(key, "t") == 0) return line_number(c, &line->t);
  if (strcmp(key, "p") == 0) return line_number(c, &line->p);
  if (strcmp(key, "backlog") == 0) return line_number(c, &line->backlog);
  if (strcmp(key, "window") == 0) return line_number(c, &line->window);
  if (strcmp(key, "clouds") == 0) return line_clouds(c, line);
  return line_skip(c);
}

/* 1 if the text is a header or an input of the trace. */
static inline int line_parse(const char *text, struct line *line) {
  cursor c = line_expect(text, '{');
  memset(line, 0, sizeof *line);
  line->kind = LINE_NONE;
  while (c != NULL) {
    char key[12];
    c = line_expect(line_text(c, key, sizeof key), ':');
    if (c == NULL) return 0;
    c = line_member(c, key, line);
    if (c == NULL) return 0;
    c = line_space(c);
    if (*c == '}') return line->kind != LINE_NONE;
    c = line_expect(c, ',');
  }
  return 0;
}

/* Text to be written: at most 32 lines of 120 bytes, and one firing says no more. */
struct said {
  size_t len;
  char text[8192];
};

static inline void say_text(struct said *said, const char *text) {
  size_t len = strlen(text);
  if (len <= sizeof said->text - said->len) {
    memcpy(said->text + said->len, text, len);
    said->len += len;
  }
}

static inline void say_number(struct said *said, uint64_t number) {
  char digits[21];
  size_t at = sizeof digits - 1U;
  digits[at] = '\0';
  do {
    digits[--at] = (char)('0' + (int)(number % 10U));
    number /= 10U;
  } while (number > 0U);
  say_text(said, digits + at);
}

static inline void say_head(struct said *said, const char *ev, uint64_t at, uint64_t t) {
  say_text(said, "{\"ev\":\"");
  say_text(said, ev);
  say_text(said, "\",\"at\":");
  say_number(said, at);
  say_text(said, ",\"t\":");
  say_number(said, t);
}

static inline void say_member(struct said *said, const char *key, uint64_t number) {
  say_text(said, ",\"");
  say_text(said, key);
  say_text(said, "\":");
  say_number(said, number);
}

static inline void say_why(struct said *said, const char *why) {
  say_text(said, ",\"why\":\"");
  say_text(said, why);
  say_text(said, "\"");
}

static inline void say_end(struct said *said) { say_text(said, "}\n"); }

/* Writes the gathered text. Ends the program if nobody reads it. */
static inline void say_now(struct said *said) {
  size_t done = 0;
  while (done < said->len) {
    ssize_t written = write(1, said->text + done, said->len - done);
    if (written <= 0) _exit(2);
    done += (size_t)written;
  }
  said->len = 0;
}

/* Reads lines until the input ends. `reply` gathers the answer to a line, or returns 0. Returns the exit code. */
static inline int serve(struct said *said, int (*reply)(const char *text)) {
  static char input[LINE_LONGEST + 1];
  size_t len = 0;
  for (;;) {
    ssize_t got = read(0, input + len, sizeof input - 1U - len);
    char *end;
    if (got <= 0) return got == 0 && len == 0 ? 0 : 2;
    len += (size_t)got;
    while ((end = (char *)memchr(input, '\n', len)) != NULL) {
      size_t used = (size_t)(end - input) + 1U;
      *end = '\0';
      if (!reply(input)) return 1;
      say_text(said, "{\"ev\":\"done\"}\n");
      say_now(said);
      len -= used;
      memmove(input, input + used, len);
    }
    if (len == sizeof input - 1U) return 2;
  }
}

#endif /* FUSELINE_TESTS_LINE_H */
