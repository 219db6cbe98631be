/* Reference firmware: the board's side of the rig's protocol, version 1, in C99.
 *
 * No allocation, no floating point, no clock and no port of its own. The main loop hands in bytes and ticks (1 us,
 * 32 bit, wrapping); whoever ports it supplies rig_pulse and rig_send, and a hardware watchdog of 500 ms:
 *
 *     for (;;) {
 *         size_t n = uart_read(bytes, sizeof bytes);
 *         rig_receive(&board, bytes, n, micros());    // bytes first: own lateness is not the host's silence
 *         rig_advance(&board, micros());
 *         watchdog_feed();
 *     }
 *
 * Messages, codes and rules: documentation of the crate firmware-protocol. The crate's tests compile this and hold it
 * to vectors/session.txt. */
#ifndef RIG_BOARD_H
#define RIG_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef RIG_CHANNELS
#define RIG_CHANNELS 8 /* at most 16 */
#endif
#ifndef RIG_SEGMENTS
#define RIG_SEGMENTS 64 /* profile segments over all channels, 6 to 8 bytes each */
#endif
/* RIG_SHORTEST_PULSE and RIG_LONGEST_PULSE [us] may be defined by a port whose pins cannot put out more: limits beyond
 * them are then refused when a channel is configured. */

enum { RIG_VERSION = 1, RIG_BODY = 64, RIG_PLAIN = 4 + RIG_BODY + 2, RIG_STUFFED = RIG_PLAIN + 1, RIG_ANSWERS = 8 };

enum rig_state { RIG_IDLE, RIG_ARMED, RIG_RUNNING, RIG_JOGGING, RIG_FAULTED };
enum rig_fault { RIG_NO_FAULT, RIG_DEAD_MAN, RIG_E_STOP, RIG_HOST_RESTARTED, RIG_SUPPLY, RIG_OVERLOAD, RIG_WATCHDOG };

typedef struct {
    uint32_t duration_us;
    uint16_t end_us;
} rig_segment;

typedef struct {
    bool configured, moving, has_track;
    uint8_t kind, safe_state;
    uint16_t min_us, max_us, park_us;
    uint32_t max_rate; /* us of pulse per second; 0: no limit */
    uint8_t name[16];
    uint16_t pulse_us; /* 0: detached */
    /* the straight line being followed */
    uint16_t from_us, to_us;
    uint32_t line_start, line_duration, line_next;
    /* this channel's part of the profile */
    uint16_t start_us, last_us, first, announced, received, played;
    uint32_t track_duration;
} rig_channel;

typedef struct {
    bool used;
    uint16_t sequence;
    uint8_t body[12];
} rig_answer;

typedef struct {
    uint32_t boot_id;
    uint8_t firmware[24];
    uint8_t state, fault;
    uint32_t fault_at, last_packet_at, start, telemetry_due;
    bool session;
    uint16_t dead_man_ms, telemetry_ms;
    rig_channel channels[RIG_CHANNELS];
    rig_segment segments[RIG_SEGMENTS];
    uint16_t segments_used;
    int8_t uploading; /* channel announced last, or -1 */
    rig_answer answers[RIG_ANSWERS];
    uint8_t next_answer;
    uint16_t sequence, damaged, refused;
    uint8_t stuffed[RIG_STUFFED];
    size_t stuffed_length;
} rig_board;

/* Supplied by the port. A pulse of 0 detaches; `at` is the tick at which it was due. */
void rig_pulse(uint8_t channel, uint16_t pulse_us, uint32_t at);
void rig_send(const uint8_t *bytes, size_t length);

/* A board just started. `boot_id` differs after each start; `fault` is RIG_NO_FAULT, or why it starts with one. */
void rig_init(rig_board *board, uint32_t boot_id, const char *firmware, uint8_t fault, uint32_t now);
/* Introduces itself unasked. */
void rig_greet(rig_board *board);
/* Takes bytes from the host, the last of which came at `now`. */
void rig_receive(rig_board *board, const uint8_t *bytes, size_t length, uint32_t now);
/* Does what is due up to `now`, each at its own tick. */
void rig_advance(rig_board *board, uint32_t now);
/* When rig_advance has something to do next; false: never. */
bool rig_next_due(const rig_board *board, uint32_t *at);
/* Latches a fault that the hardware found and makes every channel safe. */
void rig_trip(rig_board *board, uint8_t fault, uint32_t at);

#endif
