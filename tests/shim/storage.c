/*
 * Stands between a program and its disk, loaded by LD_PRELOAD: counts what the program does to files below one folder, and kills,
 * fills, slows or notes. tests/src/storage/mod.rs builds it and says what to do by environment variables:
 *
 *   STORAGE_BELOW    the folder; what happens elsewhere passes
 *   STORAGE_CONTROL  a folder for `count` and `log`, shared by all processes that carry the shim
 *   STORAGE_KILL     NUMBER:before, NUMBER:during (half of a write's bytes) or NUMBER:after
 *   STORAGE_FULL     from this event on nothing can be written or made any more: ENOSPC
 *                    nor while there is a file `full` in the control folder
 *   STORAGE_READ_ONLY nothing can be changed: EROFS
 *   STORAGE_SLOW_MS  each write and each sync takes so much longer
 *   STORAGE_DATA     bytes that are written are in the log too; events then happen one after the other
 *
 * A line of the log: number, kind, what was done (done, killed-before, killed-during, killed-after, full, read-only), process, offset, length,
 * path, second path, with tabs between; behind it the bytes, where asked for.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define REAL(name) ((__typeof__(&name))real(#name))

static char below[PATH_MAX], full_now[PATH_MAX];
static _Atomic uint64_t *count;
static int log_fd = -1;
static uint64_t kill_at, full_from;
static enum { BEFORE, DURING, AFTER } phase;
static long slow_ms;
static int with_data, read_only;
static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;

static void *real(const char *name) { return dlsym(RTLD_NEXT, name); }

/* A descriptor that the program does not come upon by chance. */
static int high(int fd) {
    int up = (int)syscall(SYS_fcntl, fd, F_DUPFD_CLOEXEC, 900);
    syscall(SYS_close, fd);
    return up;
}

__attribute__((constructor)) static void begin(void) {
    const char *folder = getenv("STORAGE_BELOW"), *control = getenv("STORAGE_CONTROL"), *text;
    if (!folder || !control) return;
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/count", control);
    int fd = (int)syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0 || syscall(SYS_ftruncate, fd, sizeof *count)) abort();
    count = mmap(NULL, sizeof *count, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    syscall(SYS_close, fd);
    snprintf(path, sizeof path, "%s/log", control);
    log_fd = high((int)syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    if (count == MAP_FAILED || log_fd < 0) abort();
    snprintf(full_now, sizeof full_now, "%s/full", control);
    if ((text = getenv("STORAGE_KILL"))) {
        char *rest;
        kill_at = strtoull(text, &rest, 10);
        phase = !strcmp(rest, ":during") ? DURING : !strcmp(rest, ":after") ? AFTER : BEFORE;
    }
    if ((text = getenv("STORAGE_FULL"))) full_from = strtoull(text, NULL, 10);
    if ((text = getenv("STORAGE_SLOW_MS"))) slow_ms = strtol(text, NULL, 10);
    read_only = getenv("STORAGE_READ_ONLY") != NULL;
    with_data = getenv("STORAGE_DATA") != NULL;
    strncpy(below, folder, sizeof below - 1);
}

/* What the servos do is written ten times a second, by the clock, and never forced: nobody counts on it, and it would make every run's
 * events others. */
static int is_hearsay(const char *path) {
    size_t length = strlen(path), name = strlen("/state.json");
    return length >= name && !strcmp(path + length - name, "/state.json");
}

static int is_below(const char *path) {
    size_t length = strlen(below);
    if (is_hearsay(path)) return 0;
    return length && !strncmp(path, below, length) && (path[length] == '/' || path[length] == '\0');
}

/* The path of an open file below the folder. */
static int of_fd(int fd, char path[PATH_MAX]) {
    if (!below[0]) return 0;
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, PATH_MAX - 1);
    if (length <= 0) return 0;
    path[length] = '\0';
    return is_below(path);
}

/* The path of what is called `name` from the folder `dir`, below the folder. */
static int of_name(int dir, const char *name, char path[PATH_MAX]) {
    if (!below[0] || !name) return 0;
    if (name[0] == '/') {
        snprintf(path, PATH_MAX, "%s", name);
    } else {
        char from[PATH_MAX];
        char link[64];
        if (dir == AT_FDCWD) snprintf(link, sizeof link, "/proc/self/cwd");
        else snprintf(link, sizeof link, "/proc/self/fd/%d", dir);
        long length = syscall(SYS_readlinkat, AT_FDCWD, link, from, PATH_MAX - 1);
        if (length <= 0) return 0;
        from[length] = '\0';
        while (!strncmp(name, "./", 2)) name += 2;
        if ((size_t)snprintf(path, PATH_MAX, "%s/%s", from, name) >= PATH_MAX) return 0;
    }
    return is_below(path);
}

static void pause_ms(long ms) {
    struct timespec left = {ms / 1000, ms % 1000 * 1000000};
    while (ms && nanosleep(&left, &left) && errno == EINTR) {}
}

struct event {
    uint64_t number;
    const char *kind, *path, *path2;
    long offset;
    size_t length;
};

static void note(const struct event *event, const char *done, size_t length, const struct iovec *data, int pieces) {
    char line[3 * PATH_MAX];
    int bytes = snprintf(line, sizeof line, "%llu\t%s\t%s\t%d\t%ld\t%zu\t%s\t%s\n", (unsigned long long)event->number, event->kind,
                         done, (int)getpid(), event->offset, length, event->path, event->path2 ? event->path2 : "");
    struct iovec all[64] = {{line, (size_t)bytes}};
    int used = 1;
    for (int i = 0; with_data && i < pieces && used < 64 && length; i++) {
        size_t taken = data[i].iov_len < length ? data[i].iov_len : length;
        all[used++] = (struct iovec){data[i].iov_base, taken};
        length -= taken;
    }
    syscall(SYS_writev, log_fd, all, used);
}

static void enter(void) {
    if (!with_data) return;
    pthread_mutex_lock(&turn);
    syscall(SYS_flock, log_fd, LOCK_EX);
}

static void leave(void) {
    if (!with_data) return;
    syscall(SYS_flock, log_fd, LOCK_UN);
    pthread_mutex_unlock(&turn);
}

static void die(void) {
    syscall(SYS_kill, (int)getpid(), SIGKILL);
    for (;;) syscall(SYS_pause);
}

/* Takes a number for the event, kills before it or refuses it where that was asked for: the error where it is refused. */
static int happens(struct event *event, int takes_room) {
    event->number = atomic_fetch_add(count, 1) + 1;
    if (kill_at == event->number && phase == BEFORE) {
        note(event, "killed-before", 0, NULL, 0);
        die();
    }
    if (takes_room && ((full_from && event->number >= full_from) || !syscall(SYS_faccessat, AT_FDCWD, full_now, F_OK))) {
        note(event, "full", 0, NULL, 0);
        return ENOSPC;
    }
    if (read_only && strncmp(event->kind, "sync", 4)) {
        note(event, "read-only", 0, NULL, 0);
        return EROFS;
    }
    return 0;
}

/* Notes the event as it went, and kills after it where that was asked for. */
static void happened(const struct event *event, long result, const struct iovec *data, int pieces) {
    int kills = kill_at == event->number && phase != BEFORE;
    size_t length = data && result > 0 ? (size_t)result : event->length;
    int saved = errno;
    if (result >= 0 || kills) note(event, kills ? "killed-after" : "done", length, data, pieces);
    if (kills) die();
    errno = saved;
}

/* One event that is a call of its own. */
#define EVENT(takes_room, what, one, two, size, call)                                                                            \
    do {                                                                                                                         \
        struct event event = {0, what, one, two, 0, size};                                                                       \
        enter();                                                                                                                 \
        int refused = happens(&event, takes_room);                                                                               \
        if (refused) {                                                                                                           \
            leave();                                                                                                             \
            errno = refused;                                                                                                     \
            return -1;                                                                                                           \
        }                                                                                                                        \
        long result = call;                                                                                                      \
        happened(&event, result, NULL, 0);                                                                                       \
        leave();                                                                                                                 \
        return result;                                                                                                           \
    } while (0)

static ssize_t written(int fd, const struct iovec *data, int pieces, off_t offset, const char *path) {
    struct event event = {0, "write", path, NULL, 0, 0};
    for (int i = 0; i < pieces; i++) event.length += data[i].iov_len;
    pause_ms(slow_ms);
    enter();
    struct stat about;
    int appends = (int)syscall(SYS_fcntl, fd, F_GETFL) & O_APPEND;
    event.offset = offset >= 0                         ? offset
                   : appends && !fstat(fd, &about) ? about.st_size
                                                   : syscall(SYS_lseek, fd, 0, SEEK_CUR);
    int refused = happens(&event, 1);
    if (refused) {
        leave();
        errno = refused;
        return -1;
    }
    int during = kill_at == event.number && phase == DURING;
    long result;
    if (during) {
        size_t half = event.length / 2;
        char *bytes = malloc(event.length + 1);
        size_t filled = 0;
        for (int i = 0; i < pieces; i++) {
            memcpy(bytes + filled, data[i].iov_base, data[i].iov_len);
            filled += data[i].iov_len;
        }
        if (offset >= 0) syscall(SYS_pwrite64, fd, bytes, half, offset);
        else syscall(SYS_write, fd, bytes, half);
        note(&event, "killed-during", half, data, pieces);
        die();
    }
    result = offset >= 0 ? syscall(SYS_pwritev, fd, data, pieces, offset, 0) : syscall(SYS_writev, fd, data, pieces);
    happened(&event, result, data, pieces);
    leave();
    return result;
}

ssize_t write(int fd, const void *bytes, size_t length) {
    char path[PATH_MAX];
    if (!of_fd(fd, path)) return syscall(SYS_write, fd, bytes, length);
    struct iovec data = {(void *)bytes, length};
    return written(fd, &data, 1, -1, path);
}

ssize_t writev(int fd, const struct iovec *data, int pieces) {
    char path[PATH_MAX];
    if (!of_fd(fd, path)) return syscall(SYS_writev, fd, data, pieces);
    return written(fd, data, pieces, -1, path);
}

ssize_t pwrite64(int fd, const void *bytes, size_t length, off64_t offset) {
    char path[PATH_MAX];
    if (!of_fd(fd, path)) return syscall(SYS_pwrite64, fd, bytes, length, offset);
    struct iovec data = {(void *)bytes, length};
    return written(fd, &data, 1, offset, path);
}

ssize_t pwrite(int fd, const void *bytes, size_t length, off_t offset) { return pwrite64(fd, bytes, length, offset); }

static int synced(int fd, long number) {
    char path[PATH_MAX];
    if (!of_fd(fd, path)) return (int)syscall(number, fd);
    struct stat about;
    int is_folder = !fstat(fd, &about) && S_ISDIR(about.st_mode);
    pause_ms(slow_ms);
    EVENT(0, is_folder ? "sync-folder" : "sync", path, NULL, 0, syscall(number, fd));
}

int fsync(int fd) { return synced(fd, SYS_fsync); }
int fdatasync(int fd) { return synced(fd, SYS_fdatasync); }

int ftruncate64(int fd, off64_t length) {
    char path[PATH_MAX];
    if (!of_fd(fd, path)) return (int)syscall(SYS_ftruncate, fd, length);
    EVENT(0, "set-length", path, NULL, (size_t)length, syscall(SYS_ftruncate, fd, length));
}
int ftruncate(int fd, off_t length) { return ftruncate64(fd, length); }

int mkdir(const char *name, mode_t mode) {
    char path[PATH_MAX];
    if (!of_name(AT_FDCWD, name, path)) return REAL(mkdir)(name, mode);
    EVENT(1, "make-folder", path, NULL, 0, REAL(mkdir)(name, mode));
}

int rmdir(const char *name) {
    char path[PATH_MAX];
    if (!of_name(AT_FDCWD, name, path)) return REAL(rmdir)(name);
    EVENT(0, "remove", path, NULL, 0, REAL(rmdir)(name));
}

int unlink(const char *name) {
    char path[PATH_MAX];
    if (!of_name(AT_FDCWD, name, path)) return REAL(unlink)(name);
    EVENT(0, "remove", path, NULL, 0, REAL(unlink)(name));
}

int rename(const char *from, const char *to) {
    char path[PATH_MAX], path2[PATH_MAX];
    if (!of_name(AT_FDCWD, from, path) || !of_name(AT_FDCWD, to, path2)) return REAL(rename)(from, to);
    EVENT(0, "rename", path, path2, 0, REAL(rename)(from, to));
}

/* Opening changes the disk where it makes a file or empties one. */
static int opened(int dir, const char *name, int flags, mode_t mode) {
    char path[PATH_MAX];
    struct stat about;
    if (read_only && (flags & O_ACCMODE) != O_RDONLY && of_name(dir, name, path)) {
        errno = fstatat(dir, name, &about, 0) && !(flags & O_CREAT) ? ENOENT : EROFS;
        return -1;
    }
    if (!(flags & (O_CREAT | O_TRUNC)) || (flags & O_TMPFILE) == O_TMPFILE || !of_name(dir, name, path))
        return (int)syscall(SYS_openat, dir, name, flags, mode);
    int is_there = !fstatat(dir, name, &about, 0);
    if (!is_there && flags & O_CREAT) EVENT(1, "create", path, NULL, 0, syscall(SYS_openat, dir, name, flags, mode));
    if (is_there && flags & O_TRUNC && !(flags & O_EXCL))
        EVENT(0, "set-length", path, NULL, 0, syscall(SYS_openat, dir, name, flags, mode));
    return (int)syscall(SYS_openat, dir, name, flags, mode);
}

#define MODE(flags)                                                                                                              \
    mode_t mode = 0;                                                                                                             \
    if (flags & (O_CREAT | O_TMPFILE)) {                                                                                         \
        va_list more;                                                                                                            \
        va_start(more, flags);                                                                                                   \
        mode = va_arg(more, mode_t);                                                                                             \
        va_end(more);                                                                                                            \
    }

int open(const char *name, int flags, ...) {
    MODE(flags)
    return opened(AT_FDCWD, name, flags, mode);
}
int open64(const char *name, int flags, ...) {
    MODE(flags)
    return opened(AT_FDCWD, name, flags | O_LARGEFILE, mode);
}
int openat(int dir, const char *name, int flags, ...) {
    MODE(flags)
    return opened(dir, name, flags, mode);
}
int openat64(int dir, const char *name, int flags, ...) {
    MODE(flags)
    return opened(dir, name, flags | O_LARGEFILE, mode);
}
