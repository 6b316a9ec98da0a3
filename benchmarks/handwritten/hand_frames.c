/* Event trigger and the frames that go out; the tick itself. */
#include <stdbool.h>
#include "hand.h"
#include "canroll_check.h"

enum { NOTHING, TRIGGERED, HEARTBEAT };
enum { STEPS_MAX = 16, FIRST_COUNTS = 2, LAST_PAGE = 6 };
enum { COUNTERS = 15, SENT = 16, LATE_ECHOES = 3, SPARE = 1 };
/* the checksum after both bytes of the data id */
enum { CRC_FORCES = 85, CRC_STATUS = 187, CRC_DIAGNOSTICS = 247 };

/* A new echo is late where its command was sent longer ago than it is due. */
static void note_echo(canroll_ecu *ecu, const canroll_calibration *cal)
{
    int32_t behind = ecu->tx_counter[CANROLL_TX_SUSPENSION_FORCE] - ecu->accepted_counter;
    behind += (behind < 0) ? COUNTERS : 0;
    if (behind < ecu->commands_sent) {
        const uint32_t newer = (behind < 0) ? 0u : (behind < SENT) ? (uint32_t)behind : SENT - 1u;
        const uint8_t sent = ecu->sent_time[(ecu->sent_last - newer) & (SENT - 1u)];
        if ((uint8_t)((uint32_t)ecu->time - sent) < cal->acknowledge_ticks - SPARE) {
            ecu->evidence[ROW_ECHO] = 0;
        } else if (ecu->evidence[ROW_ECHO] < LATE_ECHOES) {
            ecu->evidence[ROW_ECHO]++;
        }
    }
}

/* Take note of a new echo: one that stands still is of long ago. */
static void acknowledge(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const uint8_t echo = ecu->accepted_counter;
    if (ecu->waiting && ecu->fresh[CANROLL_RX_ACTUATOR_STATE] && ecu->command_held
        && echo != ecu->echo) {
        ecu->echo = echo;
        ecu->unacknowledged = 0;
        note_echo(ecu, cal);
        ecu->waiting = echo != ecu->tx_counter[CANROLL_TX_SUSPENSION_FORCE];
    }
}

/* v / 2^12 to nearest: quarter newton metres. */
static inline int32_t coarse(int32_t v)
{
    return (v + 2048) >> 12;
}

/* Whether error^2 > epsilon^2 size^2 + floor^2, epsilon^2 as Q20. */
static bool moved(const canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t error = coarse(ecu->outputs[0] - ecu->sent[0]), size = coarse(ecu->sent[0]);
    const int32_t floor = coarse(cal->trigger_floor);
    const int64_t above = (int64_t)error * error - (int64_t)floor * floor;
    if (above <= 0) {
        return false;
    }
    return above << 20 > cal->trigger_epsilon_squared * ((int64_t)size * size);
}

void hand_trigger(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    const int32_t read = (cal->predict_steps > 1) ? cal->predict_steps : 1;
    int32_t under_way;
    acknowledge(ecu, cal);
    ecu->since_sent = aged(ecu->since_sent, elapsed);
    if (ecu->waiting) {
        ecu->unacknowledged = aged(ecu->unacknowledged, elapsed);
    }
    ecu->triggered = NOTHING;
    if (ecu->mode == CANROLL_INIT) {
        /* what the actuators hold of before a restart fades */
    } else if (moved(ecu, cal) || (ecu->waiting && ecu->since_sent >= cal->acknowledge_ticks)) {
        ecu->triggered = TRIGGERED;
    } else if (ecu->since_sent >= cal->heartbeat_ticks) {
        ecu->triggered = HEARTBEAT;
    }
    under_way = ecu->ring[ecu->ring_head];
    if (ecu->triggered != NOTHING) {
        ecu->since_sent = 0;
        hand_note_command(ecu, cal);
        ecu->sent_last = (ecu->sent_last + 1) & (SENT - 1);
        ecu->sent_time[ecu->sent_last] = (uint8_t)ecu->time;
        ecu->waiting = 1;
        ecu->commands_sent += (ecu->commands_sent < INT32_MAX);
        ecu->sent[0] = ecu->outputs[0];
        under_way = ecu->given;
    }
    for (int32_t k = (elapsed < read) ? elapsed : read; k > 0; k--) {
        ecu->ring_head = (ecu->ring_head + 1) & (CANROLL_N_RING - 1);
        ecu->ring[ecu->ring_head] = under_way;
    }
}

static void store(uint8_t *p, uint32_t word)
{
    p[0] = (uint8_t)word;
    p[1] = (uint8_t)(word >> 8);
    p[2] = (uint8_t)(word >> 16);
    p[3] = (uint8_t)(word >> 24);
}

/* Count, protect and queue a frame. */
static void send(canroll_ecu *ecu, uint32_t slot, uint32_t start, hand_frame frame)
{
    const uint8_t counter = (ecu->tx_counter[slot] < 14) ? (uint8_t)(ecu->tx_counter[slot] + 1) : 0;
    ecu->tx_counter[slot] = counter;
    frame.lo |= (uint32_t)counter << 8;
    frame.lo |= hand_crc(start, frame);
    store(ecu->tx_payload[slot], frame.lo);
    store(ecu->tx_payload[slot] + 4, frame.hi);
    ecu->tx_pending[slot] = 1;
}

/* A force in 2 N, 12 bits; what the limits allow fits. */
static inline uint32_t force(int32_t v)
{
    return (uint32_t)((v + 16384) >> 15) & 0xfff;
}

static void send_forces(canroll_ecu *ecu)
{
    const uint32_t rear_left = force(ecu->force[2]);
    hand_frame f;
    f.lo = force(ecu->force[0]) << 12 | (uint32_t)((ecu->force[1] + 16384) >> 15) << 24;
    f.hi = (force(ecu->force[1]) >> 8) | rear_left << 4 | force(ecu->force[3]) << 16
        | (uint32_t)ecu->mode << 28;
    send(ecu, CANROLL_TX_SUSPENSION_FORCE, CRC_FORCES, f);
}

static void send_status(canroll_ecu *ecu)
{
    const uint32_t roll = (uint32_t)product(ecu->x[CANROLL_ROLL], 938734052, 45);
    const uint32_t moment = (uint32_t)limit((ecu->moment + 4096) >> 13, -32765, 32765);
    hand_frame f;
    f.lo = (roll & 0xffff) << 12 | moment << 28;
    f.hi = ((moment >> 4) & 0xfff) | (uint32_t)ecu->mode << 12 | (uint32_t)ecu->law << 16
        | (uint32_t)ecu->fault_number << 20 | (uint32_t)ecu->commands_sent << 24;
    send(ecu, CANROLL_TX_STATUS, CRC_STATUS, f);
}

static void send_diagnostics(canroll_ecu *ecu)
{
    const uint32_t page = ecu->diagnostics_page;
    hand_frame f;
    if (page < FIRST_COUNTS) {
        const uint32_t codes = (uint32_t)((page == 0) ? ecu->fault_active : ecu->fault_latched);
        f.lo = codes << 16;
        f.hi = codes >> 16;
    } else {
        const uint8_t *count = &ecu->fault_count[6 * (page - FIRST_COUNTS)];
        f.lo = (uint32_t)count[0] << 16 | (uint32_t)count[1] << 24;
        f.hi = (uint32_t)count[2] | (uint32_t)count[3] << 8;
        if (page < LAST_PAGE) {
            f.hi |= (uint32_t)count[4] << 16 | (uint32_t)count[5] << 24;
        }
    }
    f.lo |= page << 12;
    send(ecu, CANROLL_TX_DIAGNOSTICS, CRC_DIAGNOSTICS, f);
    ecu->diagnostics_page = (page < LAST_PAGE) ? (uint8_t)(page + 1) : 0;
}

void hand_transmit(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    if (ecu->triggered != NOTHING) {
        send_forces(ecu);
    }
    ecu->since_status = aged(ecu->since_status, elapsed);
    if (ecu->since_status >= cal->status_ticks) {
        ecu->since_status = 0;
        send_status(ecu);
        send_diagnostics(ecu);
    }
}

void canroll_tick(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed_ticks)
{
    const int32_t elapsed = limit(elapsed_ticks, 1, AGE_MAX);
    const int32_t steps = limit(elapsed, 1, STEPS_MAX);
    if (ecu->refused != 0) {
        return;
    }
    hand_read_inputs(ecu, cal, elapsed);
    canroll_check_watch_calibration(ecu, cal);
    hand_supervise(ecu, cal, elapsed);
    hand_observe(ecu, cal, steps);
    hand_control(ecu, cal, steps);
    hand_guard(ecu, cal, elapsed);
    hand_allocate(ecu, cal);
    hand_bound(ecu, cal);
    hand_trigger(ecu, cal, elapsed);
    hand_transmit(ecu, cal, elapsed);
    ecu->time = (int32_t)((uint32_t)ecu->time + (uint32_t)elapsed);
}
