#include "board.h"

#include <string.h>

enum {
    HELLO = 0x01, STATUS, E_STOP, PING, DESCRIBE,
    CONFIGURE = 0x10, TIMING, CLEAR, TRACK, SEGMENTS, ARM, JOG, ABORT, ACKNOWLEDGE, GOODBYE,
    ACK = 0x80, HELLO_ANSWER, STATUS_ANSWER, PONG = 0x84, DESCRIPTION, TELEMETRY = 0x90, HAPPENED
};
enum { STARTED = 1, FINISHED, FAULTED };
enum {
    DONE, MALFORMED, OTHER_VERSION, NO_SUCH_CHANNEL, NOT_CONFIGURED, PULSE_TOO_SHORT, PULSE_TOO_LONG, RATE_TOO_HIGH,
    BUSY, LATCHED, UNDERFLOW_, TOO_FAR, NOT_AT_START, OUT_OF_ORDER, NO_ROOM, INCOMPLETE, TOO_LONG, OTHER_FAULT,
    BAD_LIMITS, BAD_TIMING, NO_SESSION
};
enum { SAFE_DETACH, SAFE_HOLD, SAFE_PARK };
enum { NO_CHANNEL = 0xff, SERVO = 0, KINDS = 3, SAFE_STATES = 3, FAULTS = 7 };

static const uint32_t UPDATE_US = 1000, MIN_LEAD_US = 5000, MAX_LEAD_US = 60000000, MAX_DURATION_US = 1800000000;

/* ---- bytes ---- */

static uint16_t get16(const uint8_t *p) { return (uint16_t)(p[0] | (uint16_t)p[1] << 8); }
static uint32_t get32(const uint8_t *p) { return get16(p) | (uint32_t)get16(p + 2) << 16; }
static void put16(uint8_t *p, uint16_t v) { p[0] = (uint8_t)v; p[1] = (uint8_t)(v >> 8); }
static void put32(uint8_t *p, uint32_t v) { put16(p, (uint16_t)v); put16(p + 2, (uint16_t)(v >> 16)); }
static int32_t since(uint32_t later, uint32_t earlier) { return (int32_t)(later - earlier); }

static uint16_t crc16(const uint8_t *bytes, size_t length)
{
    uint16_t crc = 0xffff;
    for (size_t i = 0; i < length; i++) {
        crc ^= (uint16_t)((uint16_t)bytes[i] << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

static void send(uint8_t kind, uint16_t sequence, const uint8_t *body, size_t length)
{
    uint8_t line[RIG_STUFFED + 2], *plain = line + 2;
    size_t end = 4 + length, code = 1, out = end + 4;
    plain[0] = kind;
    plain[1] = RIG_VERSION;
    put16(plain + 2, sequence);
    memcpy(plain + 4, body, length);
    put16(plain + end, crc16(plain, end));
    /* COBS, in place: each zero becomes the distance to the next one. Packets are too short for runs of 254. */
    line[0] = 0;
    for (size_t i = 2; i < out; i++) {
        if (line[i] == 0) {
            line[code] = (uint8_t)(i - code);
            code = i;
        }
    }
    line[code] = (uint8_t)(out - code);
    line[out++] = 0;
    rig_send(line, out);
}

static void say(rig_board *b, uint8_t kind, const uint8_t *body, size_t length)
{
    send(kind, ++b->sequence, body, length);
}

static void say_happened(rig_board *b, uint8_t what, uint8_t fault, uint32_t at)
{
    uint8_t body[6] = {what, fault};
    put32(body + 2, at);
    say(b, HAPPENED, body, sizeof body);
}

static size_t identity(const rig_board *b, uint8_t *body)
{
    put32(body, b->boot_id);
    put16(body + 4, RIG_SEGMENTS);
    body[6] = RIG_CHANNELS;
    body[7] = 0;
    memcpy(body + 8, b->firmware, sizeof b->firmware);
    return 8 + sizeof b->firmware;
}

/* ---- motion ---- */

static bool rate_allows(uint32_t rate, uint16_t from, uint16_t to, uint32_t duration_us)
{
    uint64_t change = (uint64_t)(from > to ? from - to : to - from) * 1000000;
    return rate == 0 || change <= (uint64_t)rate * duration_us;
}

/* Rounded up quotient of the change by a rate [us/s] or a duration [us]. */
static uint32_t change_over(uint16_t from, uint16_t to, uint32_t by)
{
    uint64_t quotient = ((uint64_t)(from > to ? from - to : to - from) * 1000000 + by - 1) / by;
    return quotient > UINT32_MAX ? UINT32_MAX : (uint32_t)quotient;
}

static uint32_t line_end(const rig_channel *c) { return c->line_start + c->line_duration; }

/* distance * part / whole to the nearest, halves up, for part < whole. Multiplies and divides bit by bit: with
 * 64-bit divisions an AVR on which eight channels move has no time left to answer. */
static uint16_t share(uint16_t distance, uint32_t part, uint32_t whole)
{
    uint32_t rest = 0;
    uint16_t quotient = 0;
    for (uint16_t bit = 0x8000; bit != 0; bit >>= 1) {
        bool carry = rest >> 31;
        quotient = (uint16_t)(quotient << 1);
        rest <<= 1;
        if (carry || rest >= whole) {
            rest -= whole;
            quotient++;
        }
        if (distance & bit) {
            rest += part;
            if (rest < part || rest >= whole) {
                rest -= whole;
                quotient++;
            }
        }
    }
    return (uint16_t)(quotient + (rest >= whole - rest));
}

static uint16_t line_at(const rig_channel *c, uint32_t now)
{
    int32_t elapsed = since(now, c->line_start);
    if (elapsed <= 0 && c->line_duration > 0)
        return c->from_us;
    if ((uint32_t)elapsed >= c->line_duration)
        return c->to_us;
    uint16_t distance = (uint16_t)(c->to_us > c->from_us ? c->to_us - c->from_us : c->from_us - c->to_us);
    uint16_t gone = share(distance, (uint32_t)elapsed, c->line_duration);
    return (uint16_t)(c->to_us > c->from_us ? c->from_us + gone : c->from_us - gone);
}

static void line_step(rig_channel *c, uint32_t now)
{
    bool still = c->from_us == c->to_us;
    c->line_next = still || since(line_end(c), now) <= (int32_t)UPDATE_US ? line_end(c) : now + UPDATE_US;
}

static void line_begin(rig_channel *c, uint16_t to_us, uint32_t duration_us, uint32_t now)
{
    c->from_us = c->pulse_us;
    c->to_us = to_us;
    c->line_start = now;
    c->line_duration = duration_us;
    c->moving = true;
    line_step(c, now);
}

static void set_pulse(rig_board *b, uint8_t n, uint16_t pulse_us, uint32_t at)
{
    if (b->channels[n].pulse_us != pulse_us) {
        b->channels[n].pulse_us = pulse_us;
        rig_pulse(n, pulse_us, at);
    }
}

/* The next line of a running profile; where none runs, as after a jog during an upload, the channel comes to rest. */
static void next_segment(rig_board *b, uint8_t n, uint32_t at)
{
    rig_channel *c = &b->channels[n];
    c->moving = false;
    if (b->state == RIG_RUNNING && c->has_track && c->played < c->received) {
        const rig_segment *s = &b->segments[c->first + c->played++];
        line_begin(c, s->end_us, s->duration_us, at);
    }
}

static void forget_profile(rig_board *b)
{
    b->segments_used = 0;
    b->uploading = -1;
    for (uint8_t n = 0; n < RIG_CHANNELS; n++)
        b->channels[n].has_track = false;
}

static void rest_if_still(rig_board *b, uint32_t at)
{
    for (uint8_t n = 0; n < RIG_CHANNELS; n++)
        if (b->channels[n].moving)
            return;
    if (b->state == RIG_RUNNING) {
        b->state = RIG_IDLE;
        forget_profile(b);
        say_happened(b, FINISHED, RIG_NO_FAULT, at);
    } else if (b->state == RIG_JOGGING) {
        b->state = RIG_IDLE;
    }
}

static void make_safe(rig_board *b, uint32_t at)
{
    forget_profile(b);
    for (uint8_t n = 0; n < RIG_CHANNELS; n++) {
        rig_channel *c = &b->channels[n];
        c->moving = false;
        if (!c->configured)
            continue;
        if (c->safe_state == SAFE_DETACH)
            set_pulse(b, n, 0, at);
        else if (c->safe_state == SAFE_PARK && c->pulse_us != 0)
            line_begin(c, c->park_us, c->max_rate ? change_over(c->pulse_us, c->park_us, c->max_rate) : 0, at);
    }
}

void rig_trip(rig_board *b, uint8_t fault, uint32_t at)
{
    if (b->state == RIG_FAULTED)
        return;
    b->state = RIG_FAULTED;
    b->fault = fault;
    b->fault_at = at;
    make_safe(b, at);
    say_happened(b, FAULTED, fault, at);
}

/* ---- what is due ---- */

enum { DUE_START = RIG_CHANNELS, DUE_TELEMETRY, DUE_DEAD_MAN, DUE_NOTHING };

static void consider(int *due, uint32_t *at, int candidate, uint32_t when)
{
    if (*due == DUE_NOTHING || since(when, *at) < 0) {
        *due = candidate;
        *at = when;
    }
}

/* Of what is due at the same tick the first named comes first; the dead-man has the last word. */
static int next_due(const rig_board *b, uint32_t *at)
{
    int due = DUE_NOTHING;
    if (b->state == RIG_ARMED)
        consider(&due, at, DUE_START, b->start);
    for (int n = 0; n < RIG_CHANNELS; n++)
        if (b->channels[n].moving)
            consider(&due, at, n, b->channels[n].line_next);
    if (b->telemetry_ms > 0)
        consider(&due, at, DUE_TELEMETRY, b->telemetry_due);
    if (b->session)
        consider(&due, at, DUE_DEAD_MAN, b->last_packet_at + UINT32_C(1000) * b->dead_man_ms);
    return due;
}

bool rig_next_due(const rig_board *b, uint32_t *at) { return next_due(b, at) != DUE_NOTHING; }

static void start_profile(rig_board *b, uint32_t at)
{
    b->state = RIG_RUNNING;
    say_happened(b, STARTED, RIG_NO_FAULT, at);
    for (uint8_t n = 0; n < RIG_CHANNELS; n++)
        if (b->channels[n].has_track)
            next_segment(b, n, at);
    rest_if_still(b, at);
}

static void update(rig_board *b, uint8_t n, uint32_t at)
{
    rig_channel *c = &b->channels[n];
    set_pulse(b, n, line_at(c, at), at);
    if (since(at, line_end(c)) >= 0) {
        next_segment(b, n, at);
        rest_if_still(b, at);
    } else {
        line_step(c, at);
    }
}

static void say_telemetry(rig_board *b, uint32_t at)
{
    uint8_t body[6 + 2 * RIG_CHANNELS];
    b->telemetry_due = at + UINT32_C(1000) * b->telemetry_ms;
    put32(body, at);
    body[4] = b->state;
    body[5] = RIG_CHANNELS;
    for (uint8_t n = 0; n < RIG_CHANNELS; n++)
        put16(body + 6 + 2 * n, b->channels[n].pulse_us);
    say(b, TELEMETRY, body, sizeof body);
}

void rig_advance(rig_board *b, uint32_t now)
{
    uint32_t at = 0;
    for (int due; (due = next_due(b, &at)) != DUE_NOTHING && since(now, at) >= 0;) {
        if (due == DUE_START) {
            start_profile(b, at);
        } else if (due == DUE_TELEMETRY) {
            say_telemetry(b, at);
        } else if (due == DUE_DEAD_MAN) {
            b->session = false;
            b->telemetry_ms = 0;
            rig_trip(b, RIG_DEAD_MAN, at);
        } else {
            update(b, (uint8_t)due, at);
        }
    }
}

/* ---- commands ---- */

typedef struct {
    uint8_t refusal, channel;
    uint32_t limit, got;
} outcome;

static outcome refuse(uint8_t refusal, uint8_t channel, uint32_t limit, uint32_t got)
{
    outcome o = {refusal, channel, limit, got};
    return o;
}

static outcome done(void) { return refuse(DONE, NO_CHANNEL, 0, 0); }

static void answer(rig_board *b, uint8_t command, uint16_t sequence, outcome o)
{
    rig_answer *a = &b->answers[b->next_answer];
    if (o.refusal != DONE)
        b->refused++;
    b->next_answer = (uint8_t)((b->next_answer + 1) % RIG_ANSWERS);
    a->used = true;
    a->sequence = sequence;
    a->body[0] = command;
    a->body[1] = o.refusal;
    a->body[2] = o.channel;
    a->body[3] = 0;
    put32(a->body + 4, o.limit);
    put32(a->body + 8, o.got);
    send(ACK, sequence, a->body, sizeof a->body);
}

static outcome in_state(const rig_board *b, unsigned allowed)
{
    if (allowed & 1u << b->state)
        return done();
    if (b->state == RIG_FAULTED)
        return refuse(LATCHED, NO_CHANNEL, 0, b->fault);
    return refuse(BUSY, NO_CHANNEL, 0, b->state);
}

static outcome usable(const rig_board *b, uint8_t n)
{
    if (n >= RIG_CHANNELS)
        return refuse(NO_SUCH_CHANNEL, n, RIG_CHANNELS, n);
    return b->channels[n].configured ? done() : refuse(NOT_CONFIGURED, n, 0, 0);
}

static outcome check_pulse(const rig_channel *c, uint8_t n, uint16_t pulse_us)
{
    if (pulse_us < c->min_us)
        return refuse(PULSE_TOO_SHORT, n, c->min_us, pulse_us);
    if (pulse_us > c->max_us)
        return refuse(PULSE_TOO_LONG, n, c->max_us, pulse_us);
    return done();
}

static outcome check_line(const rig_channel *c, uint8_t n, uint16_t from, uint16_t to, uint32_t duration_us)
{
    outcome o = check_pulse(c, n, to);
    if (o.refusal != DONE)
        return o;
    if (duration_us > MAX_DURATION_US)
        return refuse(TOO_LONG, n, MAX_DURATION_US, duration_us);
    if (!rate_allows(c->max_rate, from, to, duration_us))
        return refuse(RATE_TOO_HIGH, n, c->max_rate, change_over(from, to, duration_us ? duration_us : 1));
    return done();
}

static outcome last_track_complete(const rig_board *b)
{
    if (b->uploading >= 0) {
        const rig_channel *c = &b->channels[b->uploading];
        if (c->has_track && c->received < c->announced)
            return refuse(INCOMPLETE, (uint8_t)b->uploading, c->received, 0);
    }
    return done();
}

#define TRY(expression)              \
    do {                             \
        outcome tried = (expression); \
        if (tried.refusal != DONE)   \
            return tried;            \
    } while (0)

enum { IN_IDLE = 1 << RIG_IDLE, IN_REST = 1 << RIG_IDLE | 1 << RIG_JOGGING };

static outcome configure(rig_board *b, const uint8_t *p, uint32_t now)
{
    uint8_t n = p[0];
    uint16_t min = get16(p + 4), max = get16(p + 6), park = get16(p + 8);
    TRY(in_state(b, IN_IDLE));
    if (n >= RIG_CHANNELS)
        return refuse(NO_SUCH_CHANNEL, n, RIG_CHANNELS, n);
    if (min == 0 || park < min || park > max || (get32(p + 10) == 0 && p[1] == SERVO))
        return refuse(BAD_LIMITS, n, 0, 0);
#ifdef RIG_SHORTEST_PULSE
    if (min < RIG_SHORTEST_PULSE)
        return refuse(PULSE_TOO_SHORT, n, RIG_SHORTEST_PULSE, min);
#endif
#ifdef RIG_LONGEST_PULSE
    if (max > RIG_LONGEST_PULSE)
        return refuse(PULSE_TOO_LONG, n, RIG_LONGEST_PULSE, max);
#endif
    forget_profile(b);
    rig_channel *c = &b->channels[n];
    if (c->pulse_us != 0 && (c->pulse_us < min || c->pulse_us > max))
        set_pulse(b, n, 0, now);
    c->configured = true;
    c->kind = p[1];
    c->safe_state = p[2];
    c->min_us = min;
    c->max_us = max;
    c->park_us = park;
    c->max_rate = get32(p + 10);
    memcpy(c->name, p + 14, sizeof c->name);
    return done();
}

static outcome timing(rig_board *b, const uint8_t *p, uint32_t now)
{
    uint16_t dead_man = get16(p);
    if (dead_man < 50 || dead_man > 2000)
        return refuse(BAD_TIMING, NO_CHANNEL, dead_man < 50 ? 50 : 2000, dead_man);
    b->dead_man_ms = dead_man;
    b->telemetry_ms = get16(p + 2);
    b->telemetry_due = now + UINT32_C(1000) * b->telemetry_ms;
    return done();
}

static outcome track(rig_board *b, const uint8_t *p)
{
    uint8_t n = p[0];
    uint16_t start = get16(p + 2), count = get16(p + 4);
    TRY(in_state(b, IN_REST));
    TRY(usable(b, n));
    rig_channel *c = &b->channels[n];
    TRY(check_pulse(c, n, start));
    TRY(last_track_complete(b));
    if (c->has_track)
        return refuse(OUT_OF_ORDER, n, 0, 0);
    if (count > RIG_SEGMENTS - b->segments_used)
        return refuse(NO_ROOM, n, RIG_SEGMENTS, count);
    c->has_track = true;
    c->start_us = c->last_us = start;
    c->first = b->segments_used;
    c->announced = count;
    c->received = c->played = 0;
    c->track_duration = 0;
    b->segments_used = (uint16_t)(b->segments_used + count);
    b->uploading = (int8_t)n;
    return done();
}

static outcome segments(rig_board *b, const uint8_t *p)
{
    uint8_t n = p[0], count = p[1];
    uint16_t first = get16(p + 2);
    TRY(in_state(b, IN_REST));
    TRY(usable(b, n));
    rig_channel *c = &b->channels[n];
    if (!c->has_track || b->uploading != (int8_t)n)
        return refuse(OUT_OF_ORDER, n, 0, first);
    if (first != c->received)
        return refuse(OUT_OF_ORDER, n, c->received, first);
    if (c->announced - c->received < count)
        return refuse(NO_ROOM, n, (uint32_t)(c->announced - c->received), count);
    /* All are checked before any is taken. */
    uint16_t from = c->last_us;
    uint32_t duration = c->track_duration;
    for (uint8_t i = 0; i < count; i++) {
        uint32_t us = get32(p + 4 + 6 * i);
        uint16_t end = get16(p + 8 + 6 * i);
        TRY(check_line(c, n, from, end, us));
        from = end;
        duration += us;
        if (duration > MAX_DURATION_US)
            return refuse(TOO_LONG, n, MAX_DURATION_US, duration);
    }
    for (uint8_t i = 0; i < count; i++) {
        rig_segment *s = &b->segments[c->first + c->received++];
        s->duration_us = get32(p + 4 + 6 * i);
        s->end_us = get16(p + 8 + 6 * i);
    }
    c->last_us = from;
    c->track_duration = duration;
    return done();
}

static outcome arm(rig_board *b, const uint8_t *p, uint32_t now)
{
    uint32_t start = get32(p);
    uint16_t count = get16(p + 4);
    int32_t lead = since(start, now);
    TRY(in_state(b, IN_IDLE));
    TRY(last_track_complete(b));
    if (count == 0 || count != b->segments_used)
        return refuse(INCOMPLETE, NO_CHANNEL, b->segments_used, count);
    if (lead < (int32_t)MIN_LEAD_US)
        return refuse(UNDERFLOW_, NO_CHANNEL, MIN_LEAD_US, lead > 0 ? (uint32_t)lead : 0);
    if (lead > (int32_t)MAX_LEAD_US)
        return refuse(TOO_FAR, NO_CHANNEL, MAX_LEAD_US, (uint32_t)lead);
    for (uint8_t n = 0; n < RIG_CHANNELS; n++) {
        const rig_channel *c = &b->channels[n];
        if (c->has_track && c->pulse_us != c->start_us)
            return refuse(NOT_AT_START, n, c->pulse_us, c->start_us);
    }
    b->start = start;
    b->state = RIG_ARMED;
    return done();
}

static outcome jog(rig_board *b, const uint8_t *p, uint32_t now)
{
    uint8_t n = p[0];
    uint16_t to = get16(p + 2);
    uint32_t duration = get32(p + 4);
    TRY(in_state(b, IN_REST));
    TRY(usable(b, n));
    rig_channel *c = &b->channels[n];
    TRY(check_pulse(c, n, to));
    if (c->pulse_us == 0) {
        set_pulse(b, n, to, now);
        return done();
    }
    uint16_t from = c->moving ? line_at(c, now) : c->pulse_us;
    TRY(check_line(c, n, from, to, duration));
    line_begin(c, to, duration, now);
    c->from_us = from;
    line_step(c, now);
    b->state = RIG_JOGGING;
    rig_advance(b, now);
    return done();
}

static outcome carry_out(rig_board *b, uint8_t kind, const uint8_t *p, uint32_t now)
{
    if (!b->session)
        return refuse(NO_SESSION, NO_CHANNEL, 0, 0);
    switch (kind) {
    case CONFIGURE:
        return configure(b, p, now);
    case TIMING:
        return timing(b, p, now);
    case CLEAR:
        TRY(in_state(b, IN_REST));
        forget_profile(b);
        return done();
    case TRACK:
        return track(b, p);
    case SEGMENTS:
        return segments(b, p);
    case ARM:
        return arm(b, p, now);
    case JOG:
        return jog(b, p, now);
    case ABORT:
        TRY(in_state(b, IN_REST | 1 << RIG_ARMED | 1 << RIG_RUNNING));
        forget_profile(b);
        for (uint8_t n = 0; n < RIG_CHANNELS; n++)
            b->channels[n].moving = false;
        b->state = RIG_IDLE;
        return done();
    case ACKNOWLEDGE:
        if (p[0] != b->fault)
            return refuse(OTHER_FAULT, NO_CHANNEL, b->fault, p[0]);
        if (b->state == RIG_FAULTED) {
            b->fault = RIG_NO_FAULT;
            b->state = RIG_JOGGING; /* on its way to a park pulse, perhaps */
            rest_if_still(b, now);
        }
        return done();
    default: /* GOODBYE */
        TRY(in_state(b, IN_REST | 1 << RIG_FAULTED));
        b->session = false;
        b->telemetry_ms = 0;
        if (b->state != RIG_FAULTED) {
            make_safe(b, now);
            b->state = RIG_JOGGING;
            rest_if_still(b, now);
        }
        return done();
    }
}

static bool valid_name(const uint8_t *name, size_t length)
{
    size_t used = 0;
    while (used < length && name[used] >= 0x20 && name[used] < 0x7f)
        used++;
    for (size_t i = used; i < length; i++)
        if (name[i] != 0)
            return false;
    return used > 0;
}

/* Whether a body is exactly of its kind's form. */
static bool well_formed(uint8_t kind, const uint8_t *p, size_t length)
{
    switch (kind) {
    case HELLO: case STATUS: case E_STOP: case PING: case CLEAR: case ABORT: case GOODBYE:
        return length == 0;
    case DESCRIBE:
        return length == 1;
    case CONFIGURE:
        return length == 30 && p[1] < KINDS && p[2] < SAFE_STATES && p[3] == 0 && valid_name(p + 14, 16);
    case TIMING:
        return length == 4;
    case TRACK:
        return length == 6 && p[1] == 0;
    case SEGMENTS:
        return length >= 4 && p[1] >= 1 && p[1] <= 10 && length == 4u + 6u * p[1];
    case ARM:
        return length == 6;
    case JOG:
        return length == 8 && p[1] == 0;
    case ACKNOWLEDGE:
        return length == 1 && p[0] < FAULTS;
    default:
        return false;
    }
}

static void hello(rig_board *b, uint32_t now)
{
    if (b->state == RIG_ARMED || b->state == RIG_RUNNING)
        rig_trip(b, RIG_HOST_RESTARTED, now);
    forget_profile(b);
    memset(b->answers, 0, sizeof b->answers);
    b->session = true;
    b->last_packet_at = now;
}

static void handle(rig_board *b, const uint8_t *plain, size_t length, uint32_t now)
{
    uint8_t kind = plain[0], version = plain[1], body[RIG_BODY];
    uint16_t sequence = get16(plain + 2);
    const uint8_t *p = plain + 4;
    bool frozen = kind == HELLO || kind == STATUS || kind == E_STOP;
    if (version != RIG_VERSION && !frozen) {
        answer(b, kind, sequence, refuse(OTHER_VERSION, NO_CHANNEL, RIG_VERSION, version));
        return;
    }
    if (!well_formed(kind, p, length - 4)) {
        answer(b, kind, sequence, refuse(MALFORMED, NO_CHANNEL, 0, 0));
        return;
    }
    switch (kind) {
    case HELLO:
        if (version == RIG_VERSION)
            hello(b, now);
        send(HELLO_ANSWER, sequence, body, identity(b, body));
        return;
    case STATUS:
        body[0] = b->state;
        body[1] = b->fault;
        put16(body + 2, b->dead_man_ms);
        put32(body + 4, now);
        put32(body + 8, b->fault == RIG_NO_FAULT ? 0 : b->fault_at);
        put32(body + 12, b->boot_id);
        put16(body + 16, b->damaged);
        put16(body + 18, b->refused);
        send(STATUS_ANSWER, sequence, body, 20);
        return;
    case PING:
        put32(body, now);
        put32(body + 4, b->boot_id);
        body[8] = b->state;
        body[9] = b->fault;
        send(PONG, sequence, body, 10);
        return;
    case E_STOP:
        rig_trip(b, RIG_E_STOP, now);
        answer(b, kind, sequence, done());
        return;
    case DESCRIBE: {
        outcome o = usable(b, p[0]);
        if (o.refusal != DONE) {
            answer(b, kind, sequence, o);
            return;
        }
        const rig_channel *c = &b->channels[p[0]];
        const uint8_t head[4] = {p[0], c->kind, c->safe_state, 0};
        memcpy(body, head, sizeof head);
        put16(body + 4, c->min_us);
        put16(body + 6, c->max_us);
        put16(body + 8, c->park_us);
        put32(body + 10, c->max_rate);
        memcpy(body + 14, c->name, sizeof c->name);
        send(DESCRIPTION, sequence, body, 30);
        return;
    }
    default:
        /* Carried out once; a resent one only gets its answer again. */
        for (int i = 0; i < RIG_ANSWERS; i++) {
            const rig_answer *a = &b->answers[i];
            if (a->used && a->sequence == sequence && a->body[0] == kind) {
                send(ACK, sequence, a->body, sizeof a->body);
                return;
            }
        }
        answer(b, kind, sequence, carry_out(b, kind, p, now));
    }
}

/* Undoes COBS in place: what is written lies before what is still to be read. 0 when the bytes are none or no packet. */
static size_t unstuff(uint8_t *plain, size_t length)
{
    const uint8_t *stuffed = plain;
    size_t out = 0;
    for (size_t i = 0; i < length;) {
        size_t next = i + stuffed[i];
        if (next > length)
            return 0;
        while (++i < next)
            plain[out++] = stuffed[i];
        if (i < length)
            plain[out++] = 0;
    }
    return out >= 6 && crc16(plain, out - 2) == get16(plain + out - 2) ? out - 2 : 0;
}

void rig_receive(rig_board *b, const uint8_t *bytes, size_t length, uint32_t now)
{
    for (size_t i = 0; i < length; i++) {
        if (bytes[i] != 0) {
            if (b->stuffed_length < sizeof b->stuffed)
                b->stuffed[b->stuffed_length] = bytes[i];
            if (b->stuffed_length <= sizeof b->stuffed)
                b->stuffed_length++; /* one beyond the end: too long, known as such at its end */
            continue;
        }
        size_t stuffed = b->stuffed_length, plain_length = 0;
        b->stuffed_length = 0;
        if (stuffed == 0)
            continue;
        if (stuffed <= sizeof b->stuffed)
            plain_length = unstuff(b->stuffed, stuffed);
        if (plain_length == 0) {
            b->damaged++;
            continue;
        }
        if (b->session)
            b->last_packet_at = now;
        rig_advance(b, now);
        handle(b, b->stuffed, plain_length, now);
    }
}

void rig_greet(rig_board *b)
{
    uint8_t body[RIG_BODY];
    say(b, HELLO_ANSWER, body, identity(b, body));
}

void rig_init(rig_board *b, uint32_t boot_id, const char *firmware, uint8_t fault, uint32_t now)
{
    memset(b, 0, sizeof *b);
    b->boot_id = boot_id;
    for (size_t i = 0; i < sizeof b->firmware && firmware[i] != 0; i++)
        b->firmware[i] = (uint8_t)firmware[i];
    b->state = fault == RIG_NO_FAULT ? RIG_IDLE : RIG_FAULTED;
    b->fault = fault;
    b->fault_at = now;
    b->dead_man_ms = 250;
    b->uploading = -1;
}
