/* The header by itself, included twice. */
#include "fuseline.h"
#include "fuseline.h"

int main(void) { return fuseline_abi() == FUSELINE_ABI ? 0 : 1; }
