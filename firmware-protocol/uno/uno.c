/* Firmware of the rig's servo board for an ATmega328P at 16 MHz (Arduino Uno, Nano): the reference's state machine on
 * this chip's clock, pins and line. Pins, building, flashing: README.md. */
#include "../reference/board.h"
#include "pins.h"
#include "pulses.h"
#include "uart.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#ifndef FIRMWARE
#define FIRMWARE "rig uno 1"
#endif

/* Codes of the protocol's channel kinds. */
enum { RELEASE = 1, SYNC_LED = 2 };

static rig_board board;
static uint32_t starts EEMEM;

/* Why the chip was reset, kept where the C runtime clears nothing. */
static uint8_t reset_flags __attribute__((section(".noinit")));

/* Runs before anything else does: a watchdog that reset the chip is still on, and would again within 16 ms. */
void keep_reset_flags(void) __attribute__((naked, used, section(".init3")));
void keep_reset_flags(void)
{
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

/* Without a bootloader, and with Optiboot from 7.0 on, MCUSR says why. Older ones clear it; some hand it over in r2, but
 * they themselves leave by a watchdog, after each reset by the button or by a host that opens the port. So the firmware
 * has a witness of its own: for how long the main loop had been missing. */
static uint8_t fault_at_start(void)
{
    if (main_loop_hung())
        return RIG_WATCHDOG;
    if ((reset_flags & _BV(WDRF)) && !(reset_flags & _BV(EXTRF)))
        return RIG_WATCHDOG;
    /* At power-on the supply was low too, which is no fault. */
    if ((reset_flags & _BV(BORF)) && !(reset_flags & _BV(PORF)))
        return RIG_SUPPLY;
    return RIG_NO_FAULT;
}

static uint32_t boot_id(void)
{
    uint32_t id = eeprom_read_dword(&starts) + 1;
    eeprom_update_dword(&starts, id); /* writes only the bytes that differ */
    return id;
}

void rig_pulse(uint8_t channel, uint16_t pulse_us, uint32_t at)
{
    (void)at;
    pulses_set(channel, pulse_us);
}

/* Telemetry leaves room for what a stop is answered with, a happening and an acknowledgement: a host that wants it more
 * often than the line carries it would hear no answer. The kind stands behind a zero and the first count of COBS, for it
 * is never 0. */
void rig_send(const uint8_t *bytes, size_t length)
{
    enum { KIND = 2, TELEMETRY = 0x90, HAPPENING_BYTES = 15, ACKNOWLEDGEMENT_BYTES = 21 };
    uart_send(bytes, length, bytes[KIND] == TELEMETRY ? HAPPENING_BYTES + ACKNOWLEDGEMENT_BYTES : 0);
}

/* A channel that drives no servo is also shown as a level: held below the middle of its limits, let go from there on;
 * dark below, lit from there on. Detached is let go and dark. */
static void show_levels(void)
{
    uint8_t hold = 0, lamp = 0;
    for (uint8_t n = 0; n < RIG_CHANNELS; n++) {
        const rig_channel *c = &board.channels[n];
        if (!c->configured || c->pulse_us == 0)
            continue;
        bool high = c->pulse_us >= c->min_us + (c->max_us - c->min_us) / 2;
        if (c->kind == RELEASE && !high)
            hold = 1;
        if (c->kind == SYNC_LED && high)
            lamp = 1;
    }
    /* Single instructions: no interrupt comes between. */
    if (hold)
        PORTB |= _BV(HOLD_BIT);
    else
        PORTB &= (uint8_t)~_BV(HOLD_BIT);
    if (lamp)
        PORTB |= _BV(LAMP_BIT);
    else
        PORTB &= (uint8_t)~_BV(LAMP_BIT);
}

/* Orders an interrupt for so long from now, or for 1 ms where that is less, which does nothing: it ends a sleep. By Timer0, in steps of 4 us. */
static void wake_in(uint16_t left_us)
{
    enum { STEP_US = 4, MOST_STEPS = 250 };
    uint16_t steps = left_us / STEP_US;
    TCCR0B = 0;
    TCNT0 = 0;
    OCR0A = steps < MOST_STEPS ? (uint8_t)steps : MOST_STEPS;
    TIFR0 = _BV(OCF0A);
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
}

/* Shorter than a byte's, so that no edge waits longer for it. */
ISR(TIMER0_COMPA_vect) { TIMSK0 = 0; }

/* Sleeps until the next interrupt. One for the pulses comes every 3.5 ms; for what is due before that, one is ordered. */
static void rest(void)
{
    enum { ORDERED_WITHIN_US = 4000, NOT_WORTH_IT_US = 20 };
    uint32_t due;
    bool ordered = false;
    if (rig_next_due(&board, &due)) {
        int32_t left_us = (int32_t)(due - tick_us());
        if (left_us < NOT_WORTH_IT_US)
            return;
        ordered = left_us < ORDERED_WITHIN_US;
        if (ordered)
            wake_in((uint16_t)left_us);
    }
    cli();
    if (!uart_waits() && (!ordered || TIMSK0)) {
        sleep_enable();
        sei(); /* takes effect after the next instruction: an interrupt cannot slip in before the sleep */
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

int main(void)
{
    wdt_enable(WDTO_500MS);
    uint8_t fault = fault_at_start();
    uint32_t id = boot_id();
    set_sleep_mode(SLEEP_MODE_IDLE);
    pulses_begin();
    uart_begin();
    sei();
    rig_init(&board, id, FIRMWARE, fault, tick_us());
    rig_greet(&board);
    for (;;) {
        uint8_t byte;
        uint32_t at;
        /* No more than the ring holds: a host that floods must not keep the board from what is due. */
        for (uint8_t n = 0; n < 64 && uart_read(&byte, &at); n++)
            rig_receive(&board, &byte, 1, at);
        rig_advance(&board, tick_us());
        show_levels();
        wdt_reset();
        main_loop_here();
        rest();
    }
}
