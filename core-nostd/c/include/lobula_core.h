/* lobula_core.h: decoders, filters and representations of event cameras for firmware in C99 (and C++).
 *
 * Link liblobula_core.a. It needs memcpy, memmove, memset and memcmp, and nothing else: no heap, no clock, no I/O.
 * Objects lie in memory of yours: declare a lobula_decoder, lobula_filter or lobula_representation, and init it. Nothing
 * is freed. What a filter or surface remembers lies in memory that you bring too: ask `..._required_len` or
 * `..._state_len` how much, keep it while the object is used, and give it to nothing else. An object is used by one
 * thread or interrupt at a time, and only with the functions of the name that it was initialised with.
 *
 *   bytes --lobula_evt3_decode--> block --lobula_denoise_u16_retain--> block --lobula_count_u8_accumulate--> tensor
 *
 * Times are microseconds. Blocks, filters and windows mean what the documentation of lobula-core says, and give the same
 * bits: see core-nostd/c/examples/pipeline.c.
 */
#ifndef LOBULA_CORE_H
#define LOBULA_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lobula_status {
    LOBULA_OK = 0,
    LOBULA_BAD_PARAMETER = 1,    /* a parameter is out of its range */
    LOBULA_MEMORY_TOO_SHORT = 2, /* give as much as ..._required_len or ..._state_len says */
    LOBULA_WRONG_GEOMETRY = 3    /* the block is of another sensor; nothing was done */
} lobula_status;

/* Columns and rows of a sensor. */
typedef struct lobula_geometry {
    uint16_t width;
    uint16_t height;
} lobula_geometry;

/* A brightness change at a pixel. */
typedef struct lobula_event {
    uint32_t t;    /* sensor time in microseconds, modulo 2^32 */
    uint16_t x;    /* column */
    uint16_t y_on; /* row in bits 0 to 14; bit 15: 1 = ON (brighter) */
} lobula_event;

static inline uint16_t lobula_event_y(lobula_event event) {
    return (uint16_t)(event.y_on & 0x7FFFu);
}

static inline bool lobula_event_is_on(lobula_event event) {
    return (event.y_on & 0x8000u) != 0;
}

/* Events in stream order, in memory of yours; filters shorten it in place. */
typedef struct lobula_block {
    uint64_t t_first; /* full time near which the events' 32 bits are to be read */
    uint64_t t_last;
    lobula_geometry geometry;
    lobula_event *events;
    size_t len;
} lobula_block;

/* Full time of an event of a block. */
static inline uint64_t lobula_event_time(const lobula_block *block, lobula_event event) {
    return block->t_first + (uint64_t)(int64_t)(int32_t)(event.t - (uint32_t)block->t_first);
}

/* Memory for objects: what is in it is nobody's business. */
typedef struct lobula_decoder {
    uint64_t opaque[32];
} lobula_decoder;
typedef struct lobula_filter {
    uint64_t opaque[40];
} lobula_filter;
typedef struct lobula_representation {
    uint64_t opaque[24];
} lobula_representation;

/* ---- Decoders: bytes of a camera to events ---- */

/* Bytes taken = bytes_decoded + bytes_faulty + those of a word that is not complete yet (7 at most). */
typedef struct lobula_counters {
    uint64_t bytes_decoded;
    uint64_t bytes_faulty;
    uint64_t events;     /* those off the sensor included */
    uint64_t off_sensor; /* dropped */
    uint64_t triggers;
    uint64_t faults; /* malformed words: skipped */
} lobula_counters;

/* Fewest events that the memory given to a decoder must hold. */
#define LOBULA_EVENTS_MIN 64

/* For each FORMAT (evt2, evt21, evt21_legacy with the halves of its words swapped, evt3, evt4):
 *
 * lobula_FORMAT_decoder_init      at the start of a stream of a sensor of this size
 * lobula_FORMAT_decode            decodes bytes, split anywhere, into `events` (`room` of them, at least
 *                                 LOBULA_EVENTS_MIN) and makes a block of them; returns how many bytes were taken. Fewer
 *                                 than given: work on the block, then call again with the rest
 * lobula_FORMAT_decoder_gap       bytes were lost; `near` is about the stream time now (lobula_FORMAT_decoder_now will do)
 * lobula_FORMAT_decoder_now       stream time, also when there are no events
 * lobula_FORMAT_decoder_counters  what was done so far
 */
#define LOBULA_DECODER(FORMAT)                                                                                        \
    void lobula_##FORMAT##_decoder_init(lobula_decoder *decoder, lobula_geometry geometry);                           \
    size_t lobula_##FORMAT##_decode(lobula_decoder *decoder, const uint8_t *bytes, size_t len, lobula_event *events,  \
                                    size_t room, lobula_block *block);                                                \
    void lobula_##FORMAT##_decoder_gap(lobula_decoder *decoder, uint64_t near);                                       \
    uint64_t lobula_##FORMAT##_decoder_now(lobula_decoder *decoder);                                                  \
    lobula_counters lobula_##FORMAT##_decoder_counters(lobula_decoder *decoder);

LOBULA_DECODER(evt2)
LOBULA_DECODER(evt21)
LOBULA_DECODER(evt21_legacy)
LOBULA_DECODER(evt3)
LOBULA_DECODER(evt4)

/* ---- Filters: fewer events ---- */

typedef struct lobula_polarity_params {
    bool on; /* keep ON, else OFF */
} lobula_polarity_params;

typedef struct lobula_region_of_interest_params {
    uint16_t x, y, width, height; /* keep the events within */
} lobula_region_of_interest_params;

typedef struct lobula_hot_pixel_params {
    uint8_t reserved; /* 0; pixels are added by lobula_hot_pixel_mask */
} lobula_hot_pixel_params;

typedef struct lobula_refractory_params {
    uint32_t period_us; /* least time between events of a pixel */
    bool refresh_all;   /* whether dropped events start a period too */
    uint8_t shift;      /* ticks of 2^shift us; 0 for u32 */
} lobula_refractory_params;

typedef struct lobula_background_activity_params {
    uint32_t dt_us;       /* how long ago a neighbour's event still supports */
    bool four_neighbours; /* else eight */
    uint8_t shift;
} lobula_background_activity_params;

typedef struct lobula_denoise_params {
    uint32_t refractory_us; /* 0: any */
    uint32_t support_us;
    uint32_t trail_us;  /* 0: none */
    uint8_t support;    /* of 8 neighbours */
    bool same_polarity; /* whether only events of the same polarity support */
    uint8_t shift;      /* ticks of 2^shift us; 0 for u32 */
} lobula_denoise_params;

typedef struct lobula_double_window_params {
    uint16_t window; /* events in each of the two windows */
    uint16_t distance_px;
    uint16_t support;
} lobula_double_window_params;

typedef struct lobula_stcf_params {
    uint32_t dt_us;     /* how long ago a neighbour's event still supports */
    uint8_t support;    /* of 8 neighbours */
    bool same_polarity; /* whether only events of the same polarity support */
    uint8_t shift;
} lobula_stcf_params;

/* The memory is the mask, bit i % 32 of word i / 32 for pixel i = y * width + x: it is read, and not cleared. */
typedef struct lobula_mask_params {
    bool outside; /* keep the events outside of the mask, else those inside */
} lobula_mask_params;

typedef struct lobula_leaky_hot_pixel_params {
    uint32_t period_us; /* each counter loses `leak` a period */
    uint8_t limit;      /* above it a pixel is hot */
    uint8_t leak;
} lobula_leaky_hot_pixel_params;

typedef struct lobula_trail_params {
    uint32_t dt_us; /* the pause that ends a burst */
    uint8_t keep;   /* 0: trail filter, 1: STC without trail, 2: STC with trail */
    uint8_t shift;
} lobula_trail_params;

typedef struct lobula_inceptive_params {
    uint32_t dt_us;
    uint8_t keep; /* 0: inceptive, 1: confirming, 2: trailing events */
    uint8_t shift;
} lobula_inceptive_params;

typedef struct lobula_anti_flicker_params {
    uint32_t frequency_hz; /* the middle of the band */
    uint32_t band_hz;      /* to either side */
    uint8_t tile_shift;    /* tiles of 2^tile_shift pixels */
    uint8_t burst;
    uint8_t cycles;
    bool keep_flickering; /* else the steady ones */
} lobula_anti_flicker_params;

typedef struct lobula_decimate_params {
    uint32_t n; /* of how many events one is kept */
} lobula_decimate_params;

typedef struct lobula_rate_limit_params {
    uint32_t events; /* the most that are kept in a period */
    uint32_t period_us;
    uint8_t tile_shift; /* tiles of 2^tile_shift pixels share fairly */
} lobula_rate_limit_params;

/* For each FILTER, with its PARAMS and the WORD of its memory:
 *
 * lobula_FILTER_required_len  words of memory that it needs (0: give NULL and 0)
 * lobula_FILTER_init          checks everything; memory may hold anything (but a mask's)
 * lobula_FILTER_retain        keeps the events of a block that pass, in place and in order
 * lobula_FILTER_keep          whether an event passes, for those who have no block
 * lobula_FILTER_advance       tells stream time; only needed beside lobula_FILTER_keep
 */
#define LOBULA_FILTER(FILTER, PARAMS, WORD)                                                                           \
    size_t lobula_##FILTER##_required_len(lobula_geometry geometry, const PARAMS *params);                            \
    lobula_status lobula_##FILTER##_init(lobula_filter *filter, lobula_geometry geometry, const PARAMS *params,       \
                                         WORD *memory, size_t len);                                                   \
    lobula_status lobula_##FILTER##_retain(lobula_filter *filter, lobula_block *block);                               \
    bool lobula_##FILTER##_keep(lobula_filter *filter, lobula_event event);                                           \
    void lobula_##FILTER##_advance(lobula_filter *filter, uint64_t now);

LOBULA_FILTER(polarity, lobula_polarity_params, uint8_t)
LOBULA_FILTER(region_of_interest, lobula_region_of_interest_params, uint8_t)
LOBULA_FILTER(hot_pixel, lobula_hot_pixel_params, uint32_t)
LOBULA_FILTER(refractory_u32, lobula_refractory_params, uint32_t)
LOBULA_FILTER(refractory_u16, lobula_refractory_params, uint16_t)
LOBULA_FILTER(background_activity_u32, lobula_background_activity_params, uint32_t)
LOBULA_FILTER(background_activity_u16, lobula_background_activity_params, uint16_t)
LOBULA_FILTER(denoise_u32, lobula_denoise_params, uint32_t)
LOBULA_FILTER(denoise_u16, lobula_denoise_params, uint16_t)
LOBULA_FILTER(double_window, lobula_double_window_params, uint32_t)
LOBULA_FILTER(stcf_u32, lobula_stcf_params, uint32_t)
LOBULA_FILTER(stcf_u16, lobula_stcf_params, uint16_t)
LOBULA_FILTER(mask, lobula_mask_params, uint32_t)
LOBULA_FILTER(leaky_hot_pixel, lobula_leaky_hot_pixel_params, uint8_t)
LOBULA_FILTER(trail_u32, lobula_trail_params, uint32_t)
LOBULA_FILTER(trail_u16, lobula_trail_params, uint16_t)
LOBULA_FILTER(inceptive_u32, lobula_inceptive_params, uint32_t)
LOBULA_FILTER(inceptive_u16, lobula_inceptive_params, uint16_t)
LOBULA_FILTER(anti_flicker, lobula_anti_flicker_params, uint32_t)
LOBULA_FILTER(decimate, lobula_decimate_params, uint8_t)
LOBULA_FILTER(rate_limit, lobula_rate_limit_params, uint32_t)

/* From now on the pixel is hot; false, and nothing is done, off the sensor. */
bool lobula_hot_pixel_mask(lobula_filter *filter, uint16_t x, uint16_t y);
bool lobula_denoise_u32_mask(lobula_filter *filter, uint16_t x, uint16_t y);
bool lobula_denoise_u16_mask(lobula_filter *filter, uint16_t x, uint16_t y);

/* ---- Representations: the events of a window to a tensor ---- */

/* Values of the last six of lobula_parameters; each 0 is the default. */
enum { LOBULA_POLARITIES_SIGNED = 0, LOBULA_POLARITIES_APART = 1 };
enum { LOBULA_INTERPOLATION_LINEAR = 0, LOBULA_INTERPOLATION_NEAREST = 1 };
enum { LOBULA_DECAY_EXPONENTIAL = 0, LOBULA_DECAY_LINEAR = 1 };
enum { LOBULA_COMBINE_SUM = 0, LOBULA_COMBINE_LATEST = 1 };
enum { LOBULA_BACKGROUND_BLACK = 0, LOBULA_BACKGROUND_WHITE = 1 };
enum { LOBULA_PALETTE_DARK = 0, LOBULA_PALETTE_LIGHT = 1, LOBULA_PALETTE_GRAY = 2 };

/* Each representation takes those that it knows. */
typedef struct lobula_parameters {
    uint32_t tau_us;         /* decay of a time surface or event image, 1 to 2^25: 30000 */
    uint32_t max_window_us;  /* the longest of the five scales of an MCTS, 1000 to 2^30: 30000 */
    uint32_t windows_us[16]; /* scales in place of the five, 1 to 2^30; the first `windows_len` count */
    uint32_t age_min_us;     /* ages of a TORE up to here are 0: 150 */
    uint32_t age_max_us;     /* its greatest age, up to 2^30: 5000000 */
    uint16_t windows_len;    /* 0 to 16: 0 */
    uint16_t bins;           /* of a voxel grid, stack or event spike tensor: 5 */
    uint16_t tile_px;        /* of a tile count, a power of two: 16 */
    uint16_t radius;         /* of what an event changes on a SITS or TOS, 1 to 7: 3 */
    uint16_t depth;          /* events of a pixel and polarity that a TORE holds, 1 to 16: 4 */
    uint8_t cutoff;          /* where the counts of a stacked histogram stop, 1 to 255: 10 */
    uint8_t threshold;       /* below it, a pixel of a TOS is 0, 1 to 255: 241 */
    uint8_t percentile;      /* where a countmask or red-blue clips counts, 0 to 100: 99 */
    uint8_t polarities;      /* of a voxel grid: LOBULA_POLARITIES_... */
    uint8_t interpolation;   /* of a voxel grid: LOBULA_INTERPOLATION_... */
    uint8_t decay;           /* of a time surface: LOBULA_DECAY_... */
    uint8_t combine;         /* what an event frame makes of a pixel's events: LOBULA_COMBINE_... */
    uint8_t background;      /* of a countmask: LOBULA_BACKGROUND_... */
    uint8_t palette;         /* of an event image: LOBULA_PALETTE_... */
} lobula_parameters;

/* What is behind the colons above. Start from it and change what you want otherwise. */
lobula_parameters lobula_parameters_default(void);

/* Elements of a tensor, row-major: planes, rows, columns. */
typedef struct lobula_shape {
    size_t channels;
    size_t height;
    size_t width;
} lobula_shape;

/* The bits of a number of half precision (IEEE 754 binary16). */
typedef uint16_t lobula_f16;

/* For each REPRESENTATION, with the PIXEL of its tensor; those of slice_... stand only when the window closes:
 *
 * lobula_REPRESENTATION_state_len   words of state that it needs (0: give NULL and 0)
 * lobula_REPRESENTATION_init        checks everything; the state may hold anything
 * lobula_REPRESENTATION_shape       extent of its tensor
 * lobula_REPRESENTATION_begin       a window [t0, t1) opens; `out` has `len` elements, whatever they hold
 * lobula_REPRESENTATION_accumulate  events of the window
 * lobula_REPRESENTATION_finish      the window closes: `out` is complete
 * lobula_REPRESENTATION_saturated   events that an element could not count any more, since the start
 */
#define LOBULA_REPRESENTATION(REPRESENTATION, PIXEL)                                                                  \
    size_t lobula_##REPRESENTATION##_state_len(lobula_geometry geometry, const lobula_parameters *parameters);        \
    lobula_status lobula_##REPRESENTATION##_init(lobula_representation *stage, lobula_geometry geometry,              \
                                                 const lobula_parameters *parameters, uint32_t *state, size_t len);   \
    lobula_shape lobula_##REPRESENTATION##_shape(lobula_representation *stage);                                       \
    void lobula_##REPRESENTATION##_begin(lobula_representation *stage, uint64_t t0, uint64_t t1, PIXEL *out,          \
                                         size_t len);                                                                 \
    lobula_status lobula_##REPRESENTATION##_accumulate(lobula_representation *stage, const lobula_block *block,       \
                                                       PIXEL *out, size_t len);                                       \
    void lobula_##REPRESENTATION##_finish(lobula_representation *stage, PIXEL *out, size_t len);                      \
    uint64_t lobula_##REPRESENTATION##_saturated(lobula_representation *stage);

LOBULA_REPRESENTATION(count_u8, uint8_t)
LOBULA_REPRESENTATION(count_u16, uint16_t)
LOBULA_REPRESENTATION(count_f32, float)
LOBULA_REPRESENTATION(polarity_histogram_u8, uint8_t)
LOBULA_REPRESENTATION(polarity_histogram_u16, uint16_t)
LOBULA_REPRESENTATION(polarity_histogram_f32, float)
LOBULA_REPRESENTATION(voxel_grid_f32, float)
LOBULA_REPRESENTATION(time_surface_f32, float)
LOBULA_REPRESENTATION(time_surface_f16, lobula_f16)
LOBULA_REPRESENTATION(time_surface_u8, uint8_t)
LOBULA_REPRESENTATION(tile_count_u16, uint16_t)
LOBULA_REPRESENTATION(tile_count_f32, float)
LOBULA_REPRESENTATION(binary, uint8_t)
LOBULA_REPRESENTATION(slice_polarity_histogram, uint8_t)
LOBULA_REPRESENTATION(event_frame_u8, uint8_t)
LOBULA_REPRESENTATION(event_frame_f32, float)
LOBULA_REPRESENTATION(slice_voxel_grid, float)
LOBULA_REPRESENTATION(averaged_time_surface, float)
LOBULA_REPRESENTATION(mcts_f32, float)
LOBULA_REPRESENTATION(mcts_f16, lobula_f16)
LOBULA_REPRESENTATION(tencode, uint8_t)
LOBULA_REPRESENTATION(slice_countmask, uint8_t)
LOBULA_REPRESENTATION(slice_red_blue, uint8_t)
LOBULA_REPRESENTATION(event_image, uint8_t)
LOBULA_REPRESENTATION(stacked_histogram, uint8_t)
LOBULA_REPRESENTATION(mixed_density_stack, float)
LOBULA_REPRESENTATION(event_spike_tensor, float)
LOBULA_REPRESENTATION(tore, float)
LOBULA_REPRESENTATION(sits, uint8_t)
LOBULA_REPRESENTATION(tos, uint8_t)

#undef LOBULA_DECODER
#undef LOBULA_FILTER
#undef LOBULA_REPRESENTATION

#ifdef __cplusplus
}
#endif

#endif
