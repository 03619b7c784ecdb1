/* A machine and a shared machine of a capacity that is chosen when the library is built. Run by .ci/c. */
#include "fuseline.h"

static FUSELINE_STORAGE(5, 40) storage;
static FUSELINE_SHARED_STORAGE(5, 40) shared;

int main(void) {
    fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_OF(5, 40), FUSELINE_COMMIT_EAGER, 40, 0, NULL, 1};
    fuseline_machine *machine;
    fuseline_shared *of_threads;
    return fuseline_own_capacity() != config.capacity ||
           fuseline_init(&storage, sizeof storage, &config, &machine) != FUSELINE_STATUS_DONE ||
           fuseline_shared_init(&shared, sizeof shared, &config, &of_threads) != FUSELINE_STATUS_DONE;
}
