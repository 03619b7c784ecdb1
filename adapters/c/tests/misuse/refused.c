/* Misuse of the C interface that does not compile, with the warnings that a safety team has on. As refused.cpp. */
#include "fuseline.h"

#ifndef CASE
#define CASE 0
#endif

fuseline_config right(void);
fuseline_config right(void) {
  const fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C1W4, FUSELINE_COMMIT_EAGER, 4, 0, NULL, 1};
#if CASE == 1
  /* case 1 | unused status | unused-result */
  fuseline_end(NULL);
#elif CASE == 2
  /* case 2 | configuration without a greatest deadline | missing.*initializer */
  const fuseline_config wrong = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C1W4, FUSELINE_COMMIT_EAGER, 4, 0, NULL};
  (void)wrong;
#elif CASE == 3
  /* case 3 | machine passed to functions of the other kind | incompatible.pointer */
  fuseline_shared *shared = NULL;
  return fuseline_end(shared) == FUSELINE_STATUS_DONE ? config : config;
#elif CASE == 4
  /* case 4 | signed deadline without `fuseline_deadline` | sign-conversion */
  const int64_t left = -20;
  fuseline_answer a;
  if (fuseline_offer(NULL, 0, 1, 1, left, 0, &a) == FUSELINE_STATUS_DONE) return config;
#elif CASE == 5
  /* case 5 | storage for one thread passed as its machine | incompatible.pointer */
  static fuseline_storage_c1w4 storage;
  if (fuseline_end(&storage) == FUSELINE_STATUS_DONE) return config;
#endif
  return config;
}
