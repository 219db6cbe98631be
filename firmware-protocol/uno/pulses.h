/* Servo pulses, the board's clock and the sync LED, all counted by Timer1. */
#ifndef PULSES_H
#define PULSES_H

#include <avr/io.h>
#include <stdint.h>

/* Starts the clock at 0 and the frames of 20 ms; every channel is detached. */
void pulses_begin(void);
/* From the channel's next pulse on; 0: no more pulses. A pulse that has begun is finished as it was. */
void pulses_set(uint8_t channel, uint16_t pulse_us);
/* The board's tick [us]; wraps after 71.6 minutes. */
uint32_t tick_us(void);

/* Times that Timer1 wrapped. */
extern volatile uint32_t timer1_wraps;

/* The tick's low 16 bits, where interrupts are off. Inline: an interrupt that calls a function saves every register. */
static inline uint16_t tick_low_us(void)
{
    uint16_t count = TCNT1;
    uint8_t high = (uint8_t)timer1_wraps;
    if ((TIFR1 & _BV(TOV1)) && count < 0x8000)
        high++; /* it wrapped, and the interrupt that counts this is still to come */
    return (uint16_t)((uint16_t)(high << 12) | count >> 4);
}

#endif
