/* The serial line to the host: 115200 baud, 8 bits, no parity, one stop bit. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

void uart_begin(void);
/* The next byte from the host, if there is one. With a zero, which may end a packet, comes the tick at which it came. */
bool uart_read(uint8_t *byte, uint32_t *at);
/* Whether a byte waits. */
bool uart_waits(void);
/* All of it or, where there is no room for it and so many bytes more, nothing. */
void uart_send(const uint8_t *bytes, size_t length, uint8_t spare);

#endif
