/* Replays the host's side of sessions (as in vectors/session.txt, on standard input) to the reference firmware and prints
 * the whole conversation in the same form. */
#include "board.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint8_t sent[4096];
static size_t sent_length;

void rig_pulse(uint8_t channel, uint16_t pulse_us, uint32_t at)
{
    if (pulse_us)
        printf("%" PRIu32 " %u %u\n", at, channel, pulse_us);
    else
        printf("%" PRIu32 " %u -\n", at, channel);
}

void rig_send(const uint8_t *bytes, size_t length)
{
    if (sent_length + length > sizeof sent)
        abort();
    memcpy(sent + sent_length, bytes, length);
    sent_length += length;
}

static void print_sent(uint32_t at)
{
    if (sent_length == 0)
        return;
    printf("%" PRIu32 " < ", at);
    for (size_t i = 0; i < sent_length; i++)
        printf("%02x", sent[i]);
    printf("\n");
    sent_length = 0;
}

int main(void)
{
    static rig_board board;
    char line[8192];
    bool started = false;
    while (fgets(line, sizeof line, stdin)) {
        char *rest;
        uint32_t tick = (uint32_t)strtoul(line, &rest, 10), due;
        if (rest == line) { /* a remark stands before each session */
            fputs(line, stdout);
            started = false;
            continue;
        }
        if (!started)
            rig_init(&board, 0x12345678, "bench", RIG_NO_FAULT, tick);
        started = true;
        while (rig_next_due(&board, &due) && (int32_t)(tick - due) >= 0) {
            rig_advance(&board, due);
            print_sent(due);
        }
        if (rest[1] != '>')
            continue;
        rest[strcspn(rest, "\n")] = 0;
        printf("%" PRIu32 "%s\n", tick, rest);
        uint8_t bytes[4096];
        size_t length = 0;
        unsigned byte;
        for (const char *hex = rest + 3; sscanf(hex, "%2x", &byte) == 1; hex += 2)
            bytes[length++] = (uint8_t)byte;
        rig_receive(&board, bytes, length, tick);
        print_sent(tick);
    }
    return 0;
}
