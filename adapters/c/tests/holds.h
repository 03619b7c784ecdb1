/* Shared by the programs that check conditions. C99 and C++17. */
#ifndef FUSELINE_TESTS_HOLDS_H
#define FUSELINE_TESTS_HOLDS_H

#include <stdio.h>
#include <stdlib.h>

/* Names what is being checked, for the report of a condition that does not hold. */
static const char *holds_in = "main";

/* Reports a condition that does not hold, and ends the program. */
#define HOLDS(condition) \
  do { \
    if (!(condition)) { \
      fprintf(stderr, "%s, %s:%d does not hold: %s\n", holds_in, __FILE__, __LINE__, #condition); \
      exit(1); \
    } \
  } while (0)

#endif /* FUSELINE_TESTS_HOLDS_H */
