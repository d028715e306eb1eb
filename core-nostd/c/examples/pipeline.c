/* Decode, denoise, count, decay: what firmware does with a camera's bytes, in static memory. */
#include "pipeline.h"

/* Enough for 320x320: lobula_denoise_u16_required_len and lobula_time_surface_u8_state_len say how much. */
static uint16_t denoise_memory[130000];
static uint32_t surface_state[103000];
static lobula_event events[256];

static lobula_decoder decoder;
static lobula_filter denoise;
static lobula_representation count, surface;

lobula_status pipeline_start(struct tensors *out, uint64_t t0, uint64_t t1) {
    const lobula_geometry geometry = {WIDTH, HEIGHT};
    const lobula_denoise_params params = {.refractory_us = 200, .support_us = 2000, .support = 2, .shift = 4};
    lobula_parameters parameters = lobula_parameters_default();
    lobula_status status;

    parameters.tau_us = 3000;
    lobula_evt3_decoder_init(&decoder, geometry);
    status = lobula_denoise_u16_init(&denoise, geometry, &params, denoise_memory,
                                     sizeof denoise_memory / sizeof denoise_memory[0]);
    if (status != LOBULA_OK) return status;
    if (!lobula_denoise_u16_mask(&denoise, 160, 160)) return LOBULA_BAD_PARAMETER;
    status = lobula_count_u8_init(&count, geometry, &parameters, NULL, 0);
    if (status != LOBULA_OK) return status;
    size_t state_len = lobula_time_surface_u8_state_len(geometry, &parameters);
    if (state_len > sizeof surface_state / sizeof surface_state[0]) return LOBULA_MEMORY_TOO_SHORT;
    status = lobula_time_surface_u8_init(&surface, geometry, &parameters, surface_state, state_len);
    if (status != LOBULA_OK) return status;

    lobula_count_u8_begin(&count, t0, t1, out->count, sizeof out->count);
    lobula_time_surface_u8_begin(&surface, t0, t1, out->surface, sizeof out->surface);
    return LOBULA_OK;
}

lobula_status pipeline_packet(struct tensors *out, const uint8_t *bytes, size_t len) {
    while (len > 0) {
        lobula_block block;
        size_t taken = lobula_evt3_decode(&decoder, bytes, len, events, sizeof events / sizeof events[0], &block);
        lobula_status status = lobula_denoise_u16_retain(&denoise, &block);
        if (status != LOBULA_OK) return status;
        status = lobula_count_u8_accumulate(&count, &block, out->count, sizeof out->count);
        if (status != LOBULA_OK) return status;
        status = lobula_time_surface_u8_accumulate(&surface, &block, out->surface, sizeof out->surface);
        if (status != LOBULA_OK) return status;
        bytes += taken;
        len -= taken;
    }
    return LOBULA_OK;
}

void pipeline_finish(struct tensors *out) {
    lobula_count_u8_finish(&count, out->count, sizeof out->count);
    lobula_time_surface_u8_finish(&surface, out->surface, sizeof out->surface);
    out->counters = lobula_evt3_decoder_counters(&decoder);
}
