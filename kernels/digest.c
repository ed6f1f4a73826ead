#include "kernels.h"

const char *kernels_digest(void) { return KERNELS_DIGEST; }
