/* Timer1 counts processor cycles (62.5 ns) and is never stopped or set, so the tick is nothing but its count.
 *
 * A pin moves by a write in the compare interrupt. The interrupt comes LEAD_CYCLES early, reads the counter and waits out
 * the rest to the cycle: how late other interrupts let it begin no longer shows. Compare outputs would need no wait, but
 * there are two of 16 bit, and eight servos.
 *
 * A frame of 20 ms has four slots of 5 ms, each for the two channels of a pair, which begin together by one write. So at
 * most two edges can come close to each other, both on one port: then one interrupt writes both, GAP_MERGED_US or less
 * apart, by counted cycles. Edges of different pairs never meet, as no pulse is longer than a slot. */
#include "pulses.h"
#include "pins.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

enum {
    CYCLES_PER_US = F_CPU / 1000000,
    SLOT_US = 5000,
    LONGEST_STEP_US = 3500, /* the counter wraps after 4096 us; a longer way is gone in two steps */
    STEP_US = 2500,
    GAP_MERGED_US = 40
};

/* More than the longest time for which interrupts are off elsewhere, and what this interrupt does before its wait. It
 * must fit into the 8 bits that the wait counts. */
#ifndef LEAD_CYCLES
#define LEAD_CYCLES 240
#endif

_Static_assert(F_CPU % 1000000 == 0 && CYCLES_PER_US == 16, "ticks and waits are counted for 16 MHz");
_Static_assert(LEAD_CYCLES < 256, "the wait counts 8 bits");
_Static_assert(RIG_SHORTEST_PULSE > GAP_MERGED_US + 30, "rise and fall are two interrupts");
_Static_assert(RIG_LONGEST_PULSE + GAP_MERGED_US + 30 < SLOT_US, "a pair ends before the next begins");

static uint16_t wanted_us[2 * PAIRS];

/* The next edge, prepared by the interrupt before it. */
static struct {
    uint16_t at;      /* counter at the edge */
    uint16_t slot_us; /* the same, since the slot began */
    volatile uint8_t *port;
    uint8_t first, second; /* bits to clear, the second gap_us after the first */
    uint8_t gap_us;
    uint8_t begins; /* whether the pair's pulses begin */
} edge;

/* The slot's pair: its bits and, from when its pulses begin, their lengths. */
static struct {
    uint8_t number;
    const uint16_t *wanted_us;
    uint8_t bit[2];
    uint16_t pulse_us[2];
} pair;

/* Pulses under way, the one that ends first in front. */
static struct {
    uint8_t bit;
    uint16_t end_us;
} ends[2];
static uint8_t ended, under_way;

/* A test begins just before the tick wraps. */
#ifndef FIRST_WRAPS
#define FIRST_WRAPS 0
#endif
volatile uint32_t timer1_wraps = FIRST_WRAPS;
enum { PATTERN_BEGINS = 1 };
static uint16_t pattern;

/* Slots of the sync LED since the main loop came round, and the complement, by which it is told from what memory holds
 * at power-on. */
static volatile uint8_t missing __attribute__((section(".noinit")));
static volatile uint8_t missing_check __attribute__((section(".noinit")));
enum { HUNG_SLOTS = 5 };

void main_loop_here(void)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        missing = 0;
        missing_check = 0xff;
    }
}

bool main_loop_hung(void) { return missing >= HUNG_SLOTS && (missing ^ missing_check) == 0xff; }

uint32_t tick_us(void)
{
    uint8_t interrupts = SREG;
    cli();
    timer1_instant now = timer1_now();
    uint32_t wraps = timer1_wraps;
    SREG = interrupts;
    if (now.wraps != (uint8_t)wraps)
        wraps++;
    return wraps << 12 | now.count >> 4;
}

void pulses_set(uint8_t channel, uint16_t pulse_us)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { wanted_us[channel] = pulse_us; }
}

ISR(TIMER1_OVF_vect)
{
    uint32_t n = timer1_wraps + 1;
    timer1_wraps = n;
    /* A slot of the sync LED, 65536 us: 16 wraps. After 65536 slots the tick wraps, and the pattern begins anew. Shown
     * and advanced at different wraps: each is short, for an edge may wait for it. */
    uint8_t part = (uint8_t)n & 15;
    if (part == 0) {
        if (pattern & 1)
            PORTB |= _BV(SYNC_LED_BIT);
        else
            PORTB &= (uint8_t)~_BV(SYNC_LED_BIT);
    } else if (part == 1) {
        uint8_t low = (uint8_t)pattern;
        uint8_t feedback = low ^ low >> 2 ^ low >> 3 ^ low >> 5;
        pattern >>= 1;
        if (feedback & 1)
            pattern |= 0x8000;
    } else if (part == 3) {
        uint8_t slots = missing + 1;
        missing = slots;
        missing_check = (uint8_t)~slots;
    } else if (part == 2 && (n & 0xffff0) == 0xffff0) {
        pattern = PATTERN_BEGINS;
    }
}

static inline void choose_pair(uint8_t number)
{
    pair.number = number;
    pair.wanted_us = wanted_us + 2 * number;
    uint8_t bit = number == PAIRS - 1 ? 1 : (uint8_t)(4 << 2 * number);
    pair.bit[0] = bit;
    pair.bit[1] = (uint8_t)(bit << 1);
    edge.port = number == PAIRS - 1 ? &PORTB : &PORTD;
}

static inline void sort_ends(void)
{
    under_way = ended = 0;
    uint8_t early = pair.pulse_us[1] < pair.pulse_us[0];
    for (uint8_t i = 0; i < 2; i++, early ^= 1) {
        if (pair.pulse_us[early] == 0)
            continue;
        ends[under_way].bit = pair.bit[early];
        ends[under_way].end_us = pair.pulse_us[early];
        under_way++;
    }
}

static inline void prepare_next(void)
{
    uint16_t now_us = edge.slot_us;
    uint16_t next_us = ended < under_way ? ends[ended].end_us : SLOT_US;
    edge.begins = 0;
    edge.first = edge.second = 0;
    edge.gap_us = 1;
    if (next_us - now_us > LONGEST_STEP_US) {
        next_us = now_us + STEP_US;
    } else if (ended < under_way) {
        edge.first = ends[ended++].bit;
        if (ended < under_way && ends[ended].end_us - next_us <= GAP_MERGED_US) {
            uint8_t gap = (uint8_t)(ends[ended].end_us - next_us);
            if (gap == 0) {
                edge.first |= ends[ended].bit;
            } else {
                edge.second = ends[ended].bit;
                edge.gap_us = gap;
            }
            ended++;
        }
    } else {
        edge.begins = 1;
        choose_pair((pair.number + 1) % PAIRS);
    }
    edge.at += (uint16_t)((next_us - now_us) * CYCLES_PER_US);
    edge.slot_us = next_us;
    OCR1A = edge.at - LEAD_CYCLES;
}

ISR(TIMER1_COMPA_vect)
{
    uint8_t begins = edge.begins, begin = 0;
    if (begins) {
        /* Taken over at the last moment. */
        pair.pulse_us[0] = pair.wanted_us[0];
        pair.pulse_us[1] = pair.wanted_us[1];
        if (pair.pulse_us[0])
            begin = pair.bit[0];
        if (pair.pulse_us[1])
            begin |= pair.bit[1];
    }
    volatile uint8_t *port = edge.port;
    uint8_t one = (uint8_t)((*port | begin) & ~edge.first), other = one & (uint8_t)~edge.second;
    uint8_t left = (uint8_t)edge.at, gap = edge.gap_us, count;
    __asm__ volatile(
        "lds %[count], %[counter]\n\t"
        "sub %[left], %[count]\n\t"
        "cpi %[left], %[lead]\n\t" /* as many cycles as cannot be left: late, then at once */
        "brlo 1f\n\t"
        "ldi %[left], 0\n"
        "1:\n\t" /* three cycles each round; the remainder by branches that cost one cycle more when taken */
        "subi %[left], 3\n\t"
        "brcc 1b\n\t"
        "cpi %[left], 0xfe\n\t"
        "brcc 2f\n"
        "2:\n\t"
        "cpi %[left], 0xff\n\t"
        "breq 3f\n"
        "3:\n\t"
        "st %a[port], %[one]\n\t"
        /* 16 cycles per us from the first write to the second */
        "nop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\t"
        "dec %[gap]\n\t"
        "breq 5f\n"
        "4:\n\t"
        "nop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\tnop\n\t"
        "dec %[gap]\n\t"
        "brne 4b\n\t"
        "nop\n\tnop\n"
        "5:\n\t"
        "st %a[port], %[other]\n\t"
        : [left] "+d"(left), [gap] "+r"(gap), [count] "=&r"(count)
        : [counter] "n"(_SFR_MEM_ADDR(TCNT1L)), [lead] "n"(LEAD_CYCLES), [port] "e"(port), [one] "r"(one),
          [other] "r"(other)
        : "memory");
    if (begins) {
        edge.slot_us = 0;
        sort_ends();
    }
    prepare_next();
}

void pulses_begin(void)
{
    DDRD |= PORTD_SERVOS;
    DDRB |= PORTB_SERVOS | _BV(HOLD_BIT) | _BV(LAMP_BIT) | _BV(SYNC_LED_BIT);
    /* The pattern's first bit is 1. */
    PORTB |= _BV(SYNC_LED_BIT);
    pattern = PATTERN_BEGINS;
    main_loop_here();
    choose_pair(0);
    edge.begins = 1;
    edge.gap_us = 1;
    edge.at = (uint16_t)STEP_US * CYCLES_PER_US;
    OCR1A = edge.at - LEAD_CYCLES;
    TCCR1A = 0;
    TCNT1 = 0;
    TIFR1 = _BV(TOV1) | _BV(OCF1A);
    TIMSK1 = _BV(TOIE1) | _BV(OCIE1A);
    TCCR1B = _BV(CS10);
}
