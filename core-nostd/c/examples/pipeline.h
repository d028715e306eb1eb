#ifndef PIPELINE_H
#define PIPELINE_H

#include "lobula_core.h"

enum { WIDTH = 320, HEIGHT = 320 };

struct tensors {
    lobula_counters counters;
    uint8_t count[HEIGHT * WIDTH];
    uint8_t surface[2 * HEIGHT * WIDTH];
};

/* One window, [t0, t1). */
lobula_status pipeline_start(struct tensors *out, uint64_t t0, uint64_t t1);
lobula_status pipeline_packet(struct tensors *out, const uint8_t *bytes, size_t len);
void pipeline_finish(struct tensors *out);

#endif
