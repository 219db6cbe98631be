#include "uart.h"
#include "pulses.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

/* Powers of two. RECEIVED bytes take 5.5 ms on the line, longer than the main loop is ever busy; no valid packet has
 * less than 10 bytes, so that STAMPS is enough for all of them. */
enum { RECEIVED = 64, TO_SEND = 128, STAMPS = 8 };

static struct {
    volatile uint8_t bytes[RECEIVED];
    volatile uint8_t head, tail;
} received;

/* When packets ended, the oldest first: one for each zero in `received` that follows another byte. */
static struct {
    timer1_instant at[STAMPS];
    volatile uint8_t head, tail;
} stamps;

static struct {
    volatile uint8_t bytes[TO_SEND];
    volatile uint8_t head, tail;
} to_send;

static uint8_t last_put, last_taken;

void uart_begin(void)
{
    /* 117647 baud at double speed: 2.1 % off, what the bootloader of these boards uses too; at single speed it would be
     * 3.5 %. */
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = 16; /* after the others: simavr takes the speed from this write */
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

ISR(USART_RX_vect)
{
    uint8_t byte = UDR0;
    uint8_t head = received.head, next = (uint8_t)(head + 1) % RECEIVED;
    if (next == received.tail)
        return; /* lost; the packet will not be valid and the host asks again */
    if (byte == 0 && last_put != 0) {
        uint8_t stamp = stamps.head, after = (uint8_t)(stamp + 1) % STAMPS;
        if (after == stamps.tail)
            return;
        stamps.at[stamp] = timer1_now();
        stamps.head = after;
    }
    last_put = byte;
    received.bytes[head] = byte;
    received.head = next;
}

ISR(USART_UDRE_vect)
{
    uint8_t tail = to_send.tail;
    UDR0 = to_send.bytes[tail];
    tail = (uint8_t)(tail + 1) % TO_SEND;
    to_send.tail = tail;
    if (tail == to_send.head)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
}

bool uart_waits(void) { return received.head != received.tail; }

bool uart_read(uint8_t *byte, uint32_t *at)
{
    uint8_t tail = received.tail;
    if (tail == received.head)
        return false;
    *byte = received.bytes[tail];
    received.tail = (uint8_t)(tail + 1) % RECEIVED;
    *at = tick_us();
    if (*byte == 0 && last_taken != 0) {
        uint8_t stamp = stamps.tail;
        *at -= (uint16_t)((uint16_t)*at - low_us(stamps.at[stamp]));
        stamps.tail = (uint8_t)(stamp + 1) % STAMPS;
    }
    last_taken = *byte;
    return true;
}

void uart_send(const uint8_t *bytes, size_t length, uint8_t spare)
{
    uint8_t head = to_send.head;
    uint8_t room = (uint8_t)(to_send.tail - head - 1) % TO_SEND;
    if (length + spare > room)
        return;
    for (size_t i = 0; i < length; i++) {
        to_send.bytes[head] = bytes[i];
        head = (uint8_t)(head + 1) % TO_SEND;
    }
    to_send.head = head;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
}
