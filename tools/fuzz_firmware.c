/*
 * Coverage-guided fuzzing of the firmware's entry points under the sanitizers.
 *
 *     driver INPUTS SEED CRASH        fuzz; before each input CRASH is overwritten by what repeats it
 *     driver --repeat CRASH           run the input in CRASH
 *
 * An input is a string of bytes read as operations: frames of any identifier, length and content,
 * and ticks of any number of missed periods. It runs from a state that an earlier input reached:
 * the records are plain memory, and a copy of them is kept with each input that executed an edge of
 * the firmware for the first time. After each input every field must be within its declared range.
 * material.h, made by firmware.py, has calibrations, correct frames and the ranges.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include "canroll.h"
#include "material.h"

#ifdef HAS_XCP
#include "canroll_xcp.h"
#endif
#ifdef HAS_UDS
#include "canroll_uds.h"
#endif

enum { INPUT = 128, CORPUS = 1 << 14, EDGES = 1 << 18, LONGEST = 64 };
#define STATE_ADDRESS 0x20000000
#define PAGE_ADDRESS 0x08000000

/* Each record in an allocation of its own, so that the sanitizer sees whatever leaves it. */
static canroll_ecu *ecu;
static canroll_calibration *reference, *working;
static uint8_t *payloads[LONGEST + 1]; /* a buffer of exactly n bytes for a frame of n */
#ifdef HAS_XCP
static canroll_xcp *xcp;
#endif
#ifdef HAS_UDS
static canroll_uds *uds;
#endif

typedef struct {
    canroll_ecu ecu;
    canroll_calibration working;
#ifdef HAS_XCP
    canroll_xcp xcp;
#endif
#ifdef HAS_UDS
    canroll_uds uds;
#endif
    int32_t calibration;
    int32_t length;
    uint8_t bytes[INPUT];
} entry;

static entry corpus[CORPUS];
static int32_t entries;
static int32_t chosen; /* index of the calibration */
static uint64_t frames_done, ticks_done, modes[4];

static uint64_t generator;
static uint32_t draw(uint32_t below)
{
    generator ^= generator << 13;
    generator ^= generator >> 7;
    generator ^= generator << 17;
    return (uint32_t)((generator >> 24) % below);
}

static uint8_t edges[EDGES];
static uint32_t edges_found;
static uintptr_t previous;
static int fresh;

void __sanitizer_cov_trace_pc(void);
void __sanitizer_cov_trace_pc(void)
{
    uintptr_t here = (uintptr_t)__builtin_return_address(0);
    uintptr_t edge = (here ^ (previous << 3)) % EDGES;
    previous = here;
    if (edges[edge] == 0) {
        edges[edge] = 1;
        edges_found++;
        fresh = 1;
    }
}

static void start(int32_t calibration)
{
    chosen = calibration;
    memcpy(reference, CALIBRATIONS[calibration], sizeof *reference);
    memset(ecu, 0xA5, sizeof *ecu);
    if (canroll_init(ecu, reference) != 0) {
        fprintf(stderr, "calibration %d is refused\n", (int)calibration);
        abort();
    }
#ifdef HAS_XCP
    canroll_xcp_init(xcp, reference, working, STATE_ADDRESS, PAGE_ADDRESS);
#endif
#ifdef HAS_UDS
    canroll_uds_init(uds, ecu);
#endif
}

static void keep(entry *to)
{
    to->ecu = *ecu;
    to->working = *working;
#ifdef HAS_XCP
    to->xcp = *xcp;
#endif
#ifdef HAS_UDS
    to->uds = *uds;
#endif
    to->calibration = chosen;
}

static void restore(const entry *from)
{
    *ecu = from->ecu;
    *working = from->working;
#ifdef HAS_XCP
    *xcp = from->xcp;
#endif
#ifdef HAS_UDS
    *uds = from->uds;
#endif
    chosen = from->calibration;
    memcpy(reference, CALIBRATIONS[chosen], sizeof *reference);
}

static void check_ranges(void)
{
    const uint8_t *base = (const uint8_t *)ecu;
    for (size_t k = 0; k < sizeof RANGES / sizeof RANGES[0]; k++) {
        for (int32_t n = 0; n < RANGES[k].count; n++) {
            int32_t value;
            if (RANGES[k].size == 1) {
                value = base[RANGES[k].offset + n];
            } else {
                memcpy(&value, base + RANGES[k].offset + 4 * n, 4);
            }
            if (value < RANGES[k].low || value > RANGES[k].high) {
                fprintf(stderr, "%s[%d] = %d is outside %d ... %d\n", RANGES[k].name, (int)n,
                    (int)value, (int)RANGES[k].low, (int)RANGES[k].high);
                abort();
            }
        }
    }
}

/* Hand a frame to whoever hears its identifier, as board/example.c does. */
static void deliver(uint32_t identifier, const uint8_t *bytes, int32_t size, int32_t length)
{
    uint8_t *payload = payloads[size];
    if (size > 0) {
        memcpy(payload, bytes, (size_t)size);
    }
    frames_done++;
    for (int32_t message = 0; message < CANROLL_N_FRAMES; message++) {
        if ((uint32_t)canroll_signals_rx_ids[message] == identifier) {
            canroll_receive(ecu, message, payload, length);
        }
    }
#ifdef HAS_XCP
    if (identifier == XCP_HEARS) {
        canroll_xcp_receive(xcp, payload, length);
    }
#endif
#ifdef HAS_UDS
    if (identifier == UDS_HEARS) {
        canroll_uds_receive(uds, payload, length);
    }
#endif
}

static void tick(int32_t elapsed, int take)
{
    const canroll_calibration *running = reference;
#ifdef HAS_XCP
    running = xcp->ecu_page != 0 ? working : reference;
#endif
    canroll_tick(ecu, running, elapsed);
#ifdef HAS_XCP
    canroll_xcp_tick(xcp, ecu, reference, working, elapsed);
#endif
#ifdef HAS_UDS
    canroll_uds_tick(uds, ecu, running, elapsed);
#endif
    if (take) {
        memset((void *)(uintptr_t)ecu->tx_pending, 0, sizeof ecu->tx_pending);
#ifdef HAS_XCP
        memset((void *)(uintptr_t)xcp->tx_pending, 0, sizeof xcp->tx_pending);
#endif
#ifdef HAS_UDS
        uds->tx_pending = 0;
#endif
    }
    ticks_done++;
    modes[ecu->mode & 3]++;
}

static const uint8_t *reading, *end;
static uint8_t byte(void) { return reading < end ? *reading++ : 0; }
static uint32_t word(void)
{
    uint32_t value = byte();
    value |= (uint32_t)byte() << 8;
    value |= (uint32_t)byte() << 16;
    return value | (uint32_t)byte() << 24;
}

static uint32_t next_counter(int32_t message)
{
    uint8_t last = ecu->e2e_last[message];
    return last == 255 ? 0 : (uint32_t)last + 1;
}

/* One of the correct frames of a mailbox, with the bits of `flip` changed at `place`. */
static void correct_frame(
    int32_t message, uint32_t which, uint32_t counter, uint8_t place, uint8_t flip)
{
    uint8_t bytes[LONGEST] = { 0 };
    const struct pool *pool = &POOLS[message];
    if (pool->bytes == NULL) {
        return;
    }
    size_t frame = (which % pool->variants) * pool->counters + counter % pool->counters;
    memcpy(bytes, pool->bytes + frame * (size_t)pool->length, (size_t)pool->length);
    bytes[place % pool->length] ^= flip;
    deliver((uint32_t)canroll_signals_rx_ids[message], bytes, pool->length, pool->length);
}

/* As above, with the counter that is expected next or any, and perhaps damaged. */
static void one_frame(uint8_t kind)
{
    int32_t message = byte() % CANROLL_N_FRAMES;
    uint32_t which = byte(), counter = byte();
    if (kind < 2) {
        counter = next_counter(message);
    }
    uint8_t place = kind == 3 ? byte() : 0, flip = kind == 3 ? byte() : 0;
    correct_frame(message, which, counter, place, flip);
}

/* Periods in which every mailbox gets what it expects, so that the loop becomes active. */
static void sound_periods(void)
{
    uint32_t periods = 1 + byte() % 16, which = byte();
    for (; periods > 0; periods--, which++) {
        for (int32_t message = 0; message < CANROLL_N_FRAMES; message++) {
            correct_frame(message, which, next_counter(message), 0, 0);
        }
        tick(1, 1);
    }
}

/* Any identifier, any length on the wire from 0 to 64, or a length that is none. */
static void any_frame(uint8_t kind)
{
    uint8_t bytes[LONGEST] = { 0 };
    uint32_t identifier = word();
    if (kind == 4) {
        identifier = HEARD[identifier % (sizeof HEARD / sizeof HEARD[0])];
    }
    int32_t size = byte() % (LONGEST + 1);
    for (int32_t k = 0; k < size && reading < end; k++) {
        bytes[k] = byte();
    }
    deliver(identifier, bytes, size, size);
}

/* A mailbox number and a length that no driver should give. */
static void absurd_call(void)
{
    int32_t message, length;
    uint32_t bits = word();
    memcpy(&message, &bits, 4);
    bits = word();
    memcpy(&length, &bits, 4);
    canroll_receive(ecu, message, payloads[LONGEST], length);
}

static void service_frame(void)
{
    uint8_t bytes[LONGEST] = { 0 };
    int32_t size = 1 + byte() % 8;
    for (int32_t k = 0; k < size; k++) {
        bytes[k] = byte();
    }
#ifdef HAS_XCP
    if (byte() & 1) {
        deliver(XCP_HEARS, bytes, size, size);
        return;
    }
#endif
#ifdef HAS_UDS
    deliver(UDS_HEARS, bytes, size, size);
#endif
}

static void run(const uint8_t *bytes, int32_t length)
{
    reading = bytes;
    end = bytes + length;
    previous = 0;
    while (reading < end) {
        uint8_t kind = byte() % 12;
        if (kind <= 3) {
            one_frame(kind);
        } else if (kind <= 5) {
            any_frame(kind);
        } else if (kind == 6) {
            uint32_t bits = word();
            int32_t elapsed;
            memcpy(&elapsed, &bits, 4);
            tick(elapsed, byte() & 1);
        } else if (kind == 7) {
            absurd_call();
        } else if (kind == 8) {
            service_frame();
        } else if (kind == 9) {
            tick(1, 1);
        } else {
            sound_periods();
        }
    }
    tick(1, 1);
    check_ranges();
}

static int32_t mutated(const entry *from, uint8_t *bytes)
{
    int32_t length = from->length;
    memcpy(bytes, from->bytes, (size_t)length);
    for (uint32_t n = 1 + draw(6); n > 0; n--) {
        uint32_t kind = draw(6), place = length > 0 ? draw((uint32_t)length) : 0;
        if (kind == 0 || length < 4) {
            length = (int32_t)draw(INPUT / 4) + 4;
            for (int32_t k = 0; k < length; k++) {
                bytes[k] = (uint8_t)draw(256);
            }
        } else if (kind == 1) {
            bytes[place] ^= (uint8_t)(1u << draw(8));
        } else if (kind == 2) {
            bytes[place] = (uint8_t)draw(256);
        } else if (kind == 3) {
            length = (int32_t)place + 1;
        } else if (kind == 4 && length < INPUT) {
            memmove(bytes + place + 1, bytes + place, (size_t)length - place);
            bytes[place] = (uint8_t)draw(256);
            length++;
        } else {
            const entry *other = &corpus[draw((uint32_t)entries)];
            int32_t take = other->length < INPUT - (int32_t)place ? other->length
                                                                  : INPUT - (int32_t)place;
            memcpy(bytes + place, other->bytes, (size_t)take);
            length = (int32_t)place + take;
        }
    }
    return length;
}

static entry *crash_file(const char *path)
{
    int file = open(path, O_RDWR | O_CREAT, 0600);
    if (file < 0 || ftruncate(file, sizeof(entry)) != 0) {
        perror(path);
        exit(2);
    }
    void *found = mmap(NULL, sizeof(entry), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (found == MAP_FAILED) {
        perror(path);
        exit(2);
    }
    return found;
}

static void fuzz(uint64_t inputs, entry *crash)
{
    for (int32_t k = 0; k < N_CALIBRATIONS; k++) {
        start(k);
        keep(&corpus[entries]);
        corpus[entries++].length = 0;
    }
    for (uint64_t n = 0; n < inputs; n++) {
        /* from a state of the corpus, newer ones more often, or on from where the last input ended */
        const entry *from = &corpus[draw((uint32_t)entries)];
        if (draw(4) == 0) {
            from = &corpus[(uint32_t)entries - 1 - draw((uint32_t)entries) / 8];
        }
        if (draw(8) == 0) {
            restore(from);
        }
        keep(crash);
        crash->length = mutated(from, crash->bytes);
        fresh = 0;
        run(crash->bytes, crash->length);
        if (fresh && entries < CORPUS) {
            corpus[entries++] = *crash;
        }
        if (isatty(2) && n % 65536 == 0) {
            fprintf(stderr, "\r%llu inputs, %u edges", (unsigned long long)n, edges_found);
        }
    }
    printf("%llu inputs, %llu frames, %llu ticks, %u edges, %d inputs kept, 0 crashes\n",
        (unsigned long long)inputs, (unsigned long long)frames_done,
        (unsigned long long)ticks_done, edges_found, (int)entries);
    printf("ticks in INIT %llu, ACTIVE %llu, DEGRADED %llu, SAFE %llu\n",
        (unsigned long long)modes[0], (unsigned long long)modes[1],
        (unsigned long long)modes[2], (unsigned long long)modes[3]);
}

int main(int count, char **arguments)
{
    int repeating = count == 3 && strcmp(arguments[1], "--repeat") == 0;
    if (!repeating && count != 4) {
        fprintf(stderr, "driver INPUTS SEED CRASH, or driver --repeat CRASH\n");
        return 2;
    }
    ecu = malloc(sizeof *ecu);
    reference = malloc(sizeof *reference);
    working = calloc(1, sizeof *working);
#ifdef HAS_XCP
    xcp = calloc(1, sizeof *xcp);
#endif
#ifdef HAS_UDS
    uds = calloc(1, sizeof *uds);
#endif
    for (int k = 0; k <= LONGEST; k++) {
        payloads[k] = calloc(1, (size_t)k);
    }
    entry *crash = crash_file(arguments[count - 1]);
    if (repeating) {
        restore(crash);
        run(crash->bytes, crash->length);
        puts("no crash");
        return 0;
    }
    generator = 0x9E3779B97F4A7C15u ^ strtoull(arguments[2], NULL, 10) << 20;
    for (int k = 0; k < 20; k++) {
        (void)draw(2);
    }
    fuzz(strtoull(arguments[1], NULL, 10), crash);
    return 0;
}
