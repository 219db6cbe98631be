/* Runs the firmware in simavr, an emulator of the chip, and tells every edge on every pin with the processor cycle at
 * which it came (62.5 ns of virtual time, which the load of this machine cannot touch).
 *
 *     emulator ELF [--optiboot VERSION] [--eeprom FILE]    obeys the lines of its standard input, as fast as it can
 *     emulator ELF [...] --pty LINK --edges FILE           serial line on a pseudo-terminal, at the pace of the wall clock
 *
 * Input: "send HEX" puts bytes on the line, "run CYCLE" goes on to that cycle since power-on and then tells what
 * happened, "reset FLAGS" resets the chip with these bits in MCUSR, "hang" and "hang-deaf" leave the main loop stuck,
 * with interrupts on and off. Output: "CYCLE D2 1", "CYCLE < HH" a byte begun by the board, "CYCLE > HH" one that it
 * has read, "CYCLE reset", "CYCLE began S" where the line is a pseudo-terminal: the computer's monotonic time then; and
 * at the end of a run "= CYCLE LOWEST_STACK_POINTER".
 *
 * --optiboot does what that bootloader's version does to the reset flags. --eeprom keeps the EEPROM's bytes from run to run.
 *
 * Build: cc -O2 -o emulator emulator.c -lsimavr -lelf -lutil (Debian: libsimavr-dev libelf-dev). */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pty.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <simavr/sim_elf.h>

enum {
    CLOCK_HZ = 16000000,
    CYCLES_PER_US = 16,
    /* simavr takes 11 bits for a byte, 1496 cycles at the firmware's speed. A little more, so that it tells when each
     * was read; an undisturbed line has 1360. */
    BYTE_CYCLES = 1600,
    SLICE_CYCLES = 200 * CYCLES_PER_US,
    MCUSR = 0x54,
    SPL = 0x5d,
    SPH = 0x5e,
    ENDLESS_LOOP = 0xcfff, /* rjmp to itself */
    QUEUE = 1 << 16,
    EEPROM_SIZE = 1024
};

static avr_t *avr;
static FILE *log_file;
static unsigned optiboot; /* major version; 0: no bootloader */
static const char *eeprom_file;

static uint8_t levels[3]; /* ports B, C, D */
static uint8_t queue[QUEUE];
static size_t queue_head, queue_tail;
static avr_cycle_count_t line_free_at;
static bool line_held;
/* Bytes that the firmware has not yet read. */
static uint8_t arriving[QUEUE];
static size_t arriving_count;
static int terminal = -1;
/* Bytes for the terminal. */
static uint8_t leaving[QUEUE];
static size_t leaving_count;
static unsigned lowest_stack = UINT16_MAX;

static uint32_t stuck_at;
static uint16_t stuck_code;
static bool stuck;

static void give_up(const char *form, ...)
{
    va_list arguments;
    va_start(arguments, form);
    fprintf(stderr, "emulator: ");
    vfprintf(stderr, form, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
    exit(1);
}

static void tell_level(unsigned port, unsigned bit, bool high)
{
    if ((levels[port] >> bit & 1) == high)
        return;
    levels[port] ^= (uint8_t)(1u << bit);
    /* Names as printed on the board. */
    const char *name = port == 1 ? "A" : "D";
    fprintf(log_file, "%" PRIu64 " %s%u %d\n", avr->cycle, name, port == 0 ? bit + 8 : bit, high);
}

static void pin_moved(avr_irq_t *irq, uint32_t value, void *port)
{
    tell_level((unsigned)(uintptr_t)port, irq->irq, value & 1);
}

static void byte_sent(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    uint8_t byte = (uint8_t)value;
    if (terminal < 0)
        fprintf(log_file, "%" PRIu64 " < %02x\n", avr->cycle, byte);
    else if (leaving_count < sizeof leaving)
        leaving[leaving_count++] = byte;
}

/* All of a slice at once: each write wakes whoever listens. What nobody takes is lost, as on a wire. */
static void let_leave(void)
{
    if (leaving_count > 0 && write(terminal, leaving, leaving_count) < 0 && errno != EIO && errno != EAGAIN)
        give_up("writing to the pseudo-terminal: %s", strerror(errno));
    leaving_count = 0;
}

static void line_hold(avr_irq_t *irq, uint32_t value, void *hold)
{
    (void)irq;
    if (!value)
        return;
    line_held = hold != NULL;
    /* simavr says so when the firmware has read the last byte. */
    if (!line_held && terminal < 0)
        for (size_t i = 0; i < arriving_count; i++)
            fprintf(log_file, "%" PRIu64 " > %02x\n", avr->cycle, arriving[i]);
    if (!line_held)
        arriving_count = 0;
}

static avr_cycle_count_t wake(avr_t *a, avr_cycle_count_t when, void *param)
{
    (void)a, (void)when, (void)param;
    return 0;
}

static void no_sleep(avr_t *a, avr_cycle_count_t cycles)
{
    (void)a, (void)cycles;
}

/* What the chip finds at its reset vector. */
static void after_reset(void)
{
    for (unsigned port = 0; port < 3; port++)
        for (unsigned bit = 0; bit < 8; bit++)
            tell_level(port, bit, false); /* every pin is an input again */
    const uint8_t external = 1 << 1, watchdog = 1 << 3;
    uint8_t *flags = &avr->data[MCUSR];
    /* After a reset from outside it waits for a program, and leaves by its own watchdog. */
    if (optiboot && (*flags & external))
        *flags = optiboot < 7 ? watchdog : external | watchdog;
    if (optiboot)
        avr->data[2] = *flags;
    if (optiboot >= 7 && (*flags & external))
        *flags &= (uint8_t)~watchdog;
    else if (optiboot && optiboot < 7)
        *flags = 0;
    if (stuck)
        memcpy(avr->flash + stuck_at, &stuck_code, sizeof stuck_code);
    stuck = false;
    line_held = false;
    arriving_count = 0;
}

static void reset(uint8_t flags)
{
    avr_reset(avr);
    avr->data[MCUSR] = flags;
    after_reset();
    fprintf(log_file, "%" PRIu64 " reset\n", avr->cycle);
}

static void feed_line(void)
{
    if (queue_head == queue_tail || line_held || avr->cycle < line_free_at)
        return;
    uint8_t byte = queue[queue_tail++ % QUEUE];
    if (arriving_count < sizeof arriving)
        arriving[arriving_count++] = byte;
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
    line_free_at = avr->cycle + BYTE_CYCLES;
}

/* What simavr's own loop does, for as long as no timer and no interrupt is due: it looks for them at every instruction. */
static void run_swiftly(avr_cycle_count_t until)
{
    const avr_cycle_timer_slot_t *next;
    while (avr->state == cpu_Running && avr->interrupt_state == 0 && avr->cycle < until &&
           (!(next = avr->cycle_timers.timer) || avr->cycle < next->when))
        avr->pc = avr_run_one(avr);
}

static void run_until(avr_cycle_count_t until)
{
    void (*usual_run)(avr_t *) = avr->run;
    while (avr->cycle < until) {
        feed_line();
        if (avr->state == cpu_Sleeping) {
            /* It sleeps until the next timer: let that not be beyond what is to be done here. */
            avr_cycle_count_t next = until;
            if (queue_head != queue_tail && !line_held && line_free_at < next)
                next = line_free_at;
            avr_cycle_timer_register(avr, next > avr->cycle ? next - avr->cycle : 1, wake, NULL);
        }
        if (terminal >= 0)
            run_swiftly(queue_head != queue_tail && line_free_at < until ? line_free_at : until);
        avr_run(avr);
        if (avr->run != usual_run) { /* the watchdog: the next call resets */
            avr_run(avr);
            after_reset();
            fprintf(log_file, "%" PRIu64 " reset\n", avr->cycle);
        }
        if (avr->state == cpu_Done || avr->state == cpu_Crashed)
            give_up("the firmware stopped at cycle %" PRIu64 ", address %04x", avr->cycle, (unsigned)avr->pc);
        unsigned stack = avr->data[SPL] | avr->data[SPH] << 8;
        if (stack >= 0x100 && stack < lowest_stack)
            lowest_stack = stack;
    }
}

/* The main loop runs whenever interrupts are on; where it then stands, it stays. */
static void hang(bool deaf)
{
    while (avr->state != cpu_Running || !avr->sreg[S_I])
        run_until(avr->cycle + 1);
    const uint16_t loop = ENDLESS_LOOP;
    stuck_at = avr->pc;
    memcpy(&stuck_code, avr->flash + stuck_at, sizeof stuck_code);
    memcpy(avr->flash + stuck_at, &loop, sizeof loop);
    stuck = true;
    if (deaf)
        avr->sreg[S_I] = 0;
}

static void keep_eeprom(bool store)
{
    uint8_t bytes[EEPROM_SIZE];
    avr_eeprom_desc_t all = {.ee = bytes, .offset = 0, .size = sizeof bytes};
    FILE *file = eeprom_file ? fopen(eeprom_file, store ? "wb" : "rb") : NULL;
    if (store && file) {
        avr_ioctl(avr, AVR_IOCTL_EEPROM_GET, &all);
        fwrite(bytes, 1, sizeof bytes, file);
    } else if (file && fread(bytes, 1, sizeof bytes, file) == sizeof bytes) {
        avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &all);
    }
    if (file)
        fclose(file);
    else if (store && eeprom_file)
        give_up("writing %s: %s", eeprom_file, strerror(errno));
}

static void log_nothing(avr_t *a, const int level, const char *form, va_list arguments)
{
    (void)a, (void)level, (void)form, (void)arguments;
}

static void start(const char *elf_file)
{
    avr_global_logger_set(log_nothing); /* it would go to standard output */
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    if (elf_read_firmware(elf_file, &firmware) != 0)
        give_up("reading the firmware %s: is it an ELF file for AVR?", elf_file);
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr)
        give_up("this simavr does not know the ATmega328P");
    avr_init(avr);
    avr->log = 0;
    avr_load_firmware(avr, &firmware);
    avr->frequency = CLOCK_HZ;
    avr->sleep = no_sleep;
    keep_eeprom(false);
    /* The firmware takes no external interrupts, for whose levels simavr looks at their pins in every cycle, asleep or not. */
    for (uint8_t external = 0; external < 2; external++)
        avr_extint_set_strict_lvl_trig(avr, external, 0);

    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, byte_sent, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XON, line_hold, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XOFF, line_hold, &line_held);
    for (unsigned port = 0; port < 3; port++)
        for (unsigned bit = 0; bit < 8; bit++)
            avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ("BCD"[port]), (int)bit), pin_moved,
                                    (void *)(uintptr_t)port);
    after_reset();
}

static void put(uint8_t byte)
{
    if (queue_head - queue_tail == QUEUE)
        give_up("more than %d bytes wait for the line", QUEUE);
    queue[queue_head++ % QUEUE] = byte;
}

static void obey(void)
{
    static char line[1 << 18];
    while (fgets(line, sizeof line, stdin)) {
        uint64_t number;
        char rest;
        if (sscanf(line, "run %" SCNu64 "%c", &number, &rest) == 2) {
            run_until(number);
            fprintf(log_file, "= %" PRIu64 " %u\n", avr->cycle, lowest_stack);
            fflush(log_file);
        } else if (strncmp(line, "send ", 5) == 0) {
            unsigned byte;
            if (queue_head == queue_tail && line_free_at < avr->cycle)
                line_free_at = avr->cycle;
            for (const char *hex = line + 5; sscanf(hex, "%2x", &byte) == 1; hex += 2)
                put((uint8_t)byte);
        } else if (sscanf(line, "reset %" SCNu64, &number) == 1) {
            reset((uint8_t)number);
        } else if (strcmp(line, "hang\n") == 0 || strcmp(line, "hang-deaf\n") == 0) {
            hang(line[4] == '-');
        } else {
            give_up("unknown line: %s", line);
        }
    }
}

static double wall_s(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static void serve(const char *link)
{
    int other_end;
    char name[128];
    struct termios raw;
    memset(&raw, 0, sizeof raw);
    cfmakeraw(&raw);
    if (openpty(&terminal, &other_end, name, &raw, NULL) != 0)
        give_up("opening a pseudo-terminal: %s", strerror(errno));
    fcntl(terminal, F_SETFL, O_NONBLOCK);
    unlink(link);
    if (symlink(name, link) != 0)
        give_up("linking %s to %s: %s", link, name, strerror(errno));
    /* The other end stays open here, or what the board says would be an error while nobody listens. */
    double began = wall_s();
    fprintf(log_file, "%" PRIu64 " began %.6f\n", avr->cycle, began);
    for (;;) {
        uint8_t bytes[256];
        ssize_t count = read(terminal, bytes, sizeof bytes);
        for (ssize_t i = 0; i < count; i++)
            put(bytes[i]);
        run_until(avr->cycle + SLICE_CYCLES);
        let_leave();
        fflush(log_file);
        double ahead = (double)avr->cycle / CLOCK_HZ - (wall_s() - began);
        if (ahead > 0)
            usleep((useconds_t)(ahead * 1e6));
    }
}

int main(int count, char **arguments)
{
    const char *elf_file = NULL, *link = NULL, *edges = NULL, *version = "0";
    for (int i = 1; i < count; i++) {
        const char **value = strcmp(arguments[i], "--eeprom") == 0  ? &eeprom_file
                             : strcmp(arguments[i], "--pty") == 0   ? &link
                             : strcmp(arguments[i], "--edges") == 0 ? &edges
                             : strcmp(arguments[i], "--optiboot") == 0 ? &version
                                                                       : NULL;
        if (value && ++i < count)
            *value = arguments[i];
        else
            elf_file = arguments[i];
    }
    if (!elf_file || (link && !edges))
        give_up("usage: emulator ELF [--optiboot VERSION] [--eeprom FILE] [--pty LINK --edges FILE]");
    optiboot = (unsigned)strtoul(version, NULL, 10);
    log_file = edges ? fopen(edges, "w") : stdout;
    if (!log_file)
        give_up("writing %s: %s", edges, strerror(errno));
    start(elf_file);
    if (link)
        serve(link);
    obey();
    keep_eeprom(true);
    return 0;
}
