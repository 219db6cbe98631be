/* Servo pulses, the board's clock and the sync LED, all counted by Timer1. */
#ifndef PULSES_H
#define PULSES_H

#include <avr/io.h>
#include <stdbool.h>
#include <stdint.h>

/* Starts the clock at 0 and the frames of 20 ms; every channel is detached. */
void pulses_begin(void);
/* From the channel's next pulse on; 0: no more pulses. A pulse that has begun is finished as it was. */
void pulses_set(uint8_t channel, uint16_t pulse_us);
/* The board's tick [us]; wraps after 71.6 minutes. */
uint32_t tick_us(void);

/* The main loop came round. */
void main_loop_here(void);
/* Before pulses_begin: whether it was missing for a quarter of a second when the chip was reset. */
bool main_loop_hung(void);

/* Times that Timer1 wrapped. */
extern volatile uint32_t timer1_wraps;

/* An instant, as it is read where interrupts are off: in few cycles, for an edge may wait for them. */
typedef struct {
    uint16_t count;
    uint8_t wraps; /* low bits of timer1_wraps */
} timer1_instant;

/* Always inline: an interrupt that calls a function saves every register. */
static inline __attribute__((always_inline)) timer1_instant timer1_now(void)
{
    timer1_instant now = {TCNT1, *(const volatile uint8_t *)&timer1_wraps};
    if ((TIFR1 & _BV(TOV1)) && now.count < 0x8000)
        now.wraps++; /* it wrapped, and the interrupt that counts this is still to come */
    return now;
}

/* The low 16 bits of its tick [us]. */
static inline uint16_t low_us(timer1_instant at) { return (uint16_t)((uint16_t)(at.wraps << 12) | at.count >> 4); }

#endif
