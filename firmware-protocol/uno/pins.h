/* Which pin of an Uno or a Nano does what; the table is in README.md. */
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

/* Servo channels 0 to 5 are D2 to D7, channels 6 and 7 are D8 and D9. Two neighbours make a pair: they lie on one port,
 * so that one write can move both. */
enum { PAIRS = 4, PORTD_SERVOS = 0xfc, PORTB_SERVOS = 0x03 };

enum {
    HOLD_BIT = PB2,   /* D10: a magnet that holds until the release */
    LAMP_BIT = PB3,   /* D11: a lamp that the host switches */
    SYNC_LED_BIT = PB5 /* D13, the lamp on the board too: shows the board's clock */
};

#endif
