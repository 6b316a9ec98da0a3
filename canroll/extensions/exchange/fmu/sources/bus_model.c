/* A CAN network as an FMU: frames come in at terminals, take part in arbitration, and go out to all
 * other nodes of the segment when they have received them.
 *
 * Everything at one instant is received before the arbitration of that instant is decided. */
#include <stdio.h>
#include <string.h>

#include "ls_bus.h"

#define NEVER (INT64_C(1) << 62)

enum { EXTENDED = 1, REMOTE = 2, FD = 4, BIT_RATE_SWITCH = 8, ERROR_STATE = 16, ERROR_FLAG = 32,
       RECESSIVE_INDICATOR = 64 };
enum { DELIVERED = 0, ERROR = 2, REFUSED = 8 };
enum { ACKNOWLEDGE_ERROR = 3, PRIMARY = 1, SECONDARY = 2, BIT_CODE = 1, ACK_CODE = 5 };
enum { NOW = 0, LOGGED = 2, SEGMENT_COUNT = 8, FREE_FRAME = 3 };
enum { BAUDRATE = 1, FD_BAUDRATE = 2, ARBITRATION_LOST = 4, BUFFER_AND_RETRANSMIT = 1 };

extern const char *kernel_error;

void model_defaults(model *m)
{
    model_image(&m->bus);
}

bool model_start(model *m, int64_t now_ns, fmu_reason *why)
{
    if (now_ns != 0) {
        snprintf(why->text, sizeof why->text, "the bus starts at time 0");
        return false;
    }
    for (int64_t k = 0; k < m->bus.clock[SEGMENT_COUNT]; k++) {
        int64_t rate = m->bus.segments[k].bitrate, fast = m->bus.segments[k].data_bitrate;
        if (rate <= 0 || rate > 1000000 || fast > 8000000 || (fast != 0 && fast < rate)) {
            snprintf(why->text, sizeof why->text,
                     "segment %d: bit rates of %lld and %lld bit/s cannot be", (int)k,
                     (long long)rate, (long long)fast);
            return false;
        }
        m->bus.segments[k].bit_ns = 1000000000 % rate == 0 ? 1000000000 / rate : 0;
    }
    return true;
}

static bool full(fmu_reason *why)
{
    snprintf(why->text, sizeof why->text, "more frames in one step than a terminal has room for");
    return false;
}

/* Tell every terminal on the segment of an entry of the log what came of it. */
static bool publish(model *m, fmu_buffer *tx, const bus_log *entry, fmu_reason *why)
{
    bool whole = entry->outcome == DELIVERED || entry->outcome == REFUSED;
    if ((!whole && entry->outcome != ERROR) || entry->flags & ERROR_FLAG) {
        return true;
    }
    ls_frame frame = { .ident = entry->ident,
                       .extended = (entry->flags & EXTENDED) != 0,
                       .remote = (entry->flags & REMOTE) != 0,
                       .fd = (entry->flags & FD) != 0,
                       .switched = (entry->flags & BIT_RATE_SWITCH) != 0,
                       .error_state = (entry->flags & ERROR_STATE) != 0,
                       .length = entry->length };
    memcpy(frame.data, entry->payload, sizeof frame.data);
    int64_t disturbance = m->bus.segments[entry->segment].disturbance;
    for (size_t port = 0; port < FMU_PORTS; port++) {
        const bus_nodes *node = &m->bus.nodes[bus_ports[port]];
        bool sender = bus_ports[port] == entry->sender;
        bool missed = bus_ports[port] == entry->missed;
        if (node->segment != entry->segment) {
            continue;
        }
        if (whole && !sender && !missed && !ls_transmit(&tx[port], &frame)) {
            return full(why);
        }
        if (entry->outcome == DELIVERED && sender && !ls_confirm(&tx[port], entry->ident)) {
            return full(why);
        }
        if (entry->outcome == ERROR || (entry->outcome == REFUSED && (sender || missed))) {
            bool acknowledge = disturbance == ACKNOWLEDGE_ERROR;
            bool first = entry->outcome == REFUSED ? missed : sender;
            uint8_t *at = ls_open(&tx[port], LS_BUS_ERROR, LS_HEAD + 7);
            if (at == NULL) {
                return full(why);
            }
            at = ls_put(at, entry->ident, 4);
            *at++ = acknowledge ? ACK_CODE : BIT_CODE;
            *at++ = first ? PRIMARY : SECONDARY;
            *at = sender;
        }
    }
    return true;
}

static bool process(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    while (bus_step(&m->bus, until_ns)) {
        for (; m->cursor < m->bus.clock[LOGGED]; m->cursor++) {
            const bus_log *entry = &m->bus.log[m->cursor % BUS_LOG];
            if (tx != NULL && !publish(m, tx, entry, why)) {
                return false;
            }
        }
    }
    return true;
}

bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    for (size_t port = 0; port < FMU_PORTS && tx != NULL; port++) {
        tx[port].size = 0; /* nobody listens where it was not taken before this step */
    }
    if (!process(m, tx, until_ns, why)) {
        return false;
    }
    bus_let_pass(&m->bus, until_ns);
    return true;
}

static bool configured(model *m, size_t port, const uint8_t *operation, uint32_t size,
                       fmu_reason *why)
{
    if (size < LS_HEAD + 2) {
        snprintf(why->text, sizeof why->text, "a configuration operation with wrong lengths");
        return false;
    }
    uint8_t kind = operation[LS_HEAD];
    bus_segments *segment = &m->bus.segments[m->bus.nodes[bus_ports[port]].segment];
    if (kind == ARBITRATION_LOST) {
        if (operation[LS_HEAD + 1] != BUFFER_AND_RETRANSMIT) {
            snprintf(why->text, sizeof why->text,
                     "frames that lose arbitration are sent again: DISCARD_AND_NOTIFY is not known");
            return false;
        }
        return true;
    }
    if ((kind != BAUDRATE && kind != FD_BAUDRATE) || size < LS_HEAD + 5) {
        snprintf(why->text, sizeof why->text, "a configuration of kind %u is not known",
                 (unsigned)kind);
        return false;
    }
    int64_t rate = ls_number(operation + LS_HEAD + 1, 4);
    int64_t kept = kind == BAUDRATE ? segment->bitrate : segment->data_bitrate;
    if (rate != kept) {
        snprintf(why->text, sizeof why->text,
                 "configured for %lld bit/s, but the bus has %lld bit/s: set its parameter",
                 (long long)rate, (long long)kept);
        return false;
    }
    return true;
}

bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why)
{
    uint32_t code = ls_number(operation, 4);
    if (code == LS_CONFIGURATION) {
        return configured(m, port, operation, size, why);
    }
    if (code == LS_WAKE_UP) {
        for (size_t other = 0; other < FMU_PORTS; other++) {
            if (other != port && ls_open(&tx[other], LS_WAKE_UP, LS_HEAD) == NULL) {
                return full(why);
            }
        }
        return true;
    }
    if (code != LS_CAN && code != LS_CAN_FD) {
        return true; /* the bus keeps the states of the nodes itself */
    }
    ls_frame frame;
    if (!ls_read(operation, size, &frame)) {
        snprintf(why->text, sizeof why->text, "a transmit operation with wrong lengths");
        return false;
    }
    int64_t flags = (frame.extended ? EXTENDED : 0) | (frame.remote ? REMOTE : 0)
        | (frame.fd ? FD : 0) | (frame.switched ? BIT_RATE_SWITCH : 0)
        | (frame.error_state ? RECESSIVE_INDICATOR : 0);
    if (frame.fd && m->bus.segments[m->bus.nodes[bus_ports[port]].segment].data_bitrate == 0
        && frame.switched) {
        snprintf(why->text, sizeof why->text,
                 "frame %X switches the bit rate, but the bus has no data bit rate: set it",
                 (unsigned)frame.ident);
        return false;
    }
    kernel_error = NULL;
    bool queued = bus_submit(&m->bus, bus_ports[port], now_ns, frame.ident, frame.length,
                             frame.data, flags, 0, 0) != 0;
    if (kernel_error != NULL || !queued) {
        snprintf(why->text, sizeof why->text, "frame %X: %s", (unsigned)frame.ident,
                 kernel_error != NULL ? kernel_error : "too many frames wait on the bus");
        return false;
    }
    return true;
}

int64_t model_next(model *m, fmu_buffer *tx, size_t port, int64_t now_ns)
{
    (void)tx, (void)port;
    /* nothing ends now any more: what is queued now is put on the bus */
    while (bus_next_end_ns(&m->bus) <= now_ns) {
        bus_step(&m->bus, now_ns + 1);
    }
    int64_t next = bus_next_end_ns(&m->bus);
    return next >= NEVER ? -1 : next;
}

int64_t model_period_ns(const model *m)
{
    (void)m;
    return 0;
}

int64_t model_shift_ns(const model *m)
{
    (void)m;
    return 0;
}
