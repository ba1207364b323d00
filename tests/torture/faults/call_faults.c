/* SPDX-FileCopyrightText: The kitti_ros2 authors
   SPDX-License-Identifier: Apache-2.0

   A library to preload: something goes wrong at the k-th call that concerns a path.

   FAULT_PATH   a text that the path contains, such as a folder
   FAULT_CALLS  change: calls that change a file or folder (if not set); read: calls that read one;
                memory: requests for at least FAULT_SIZE bytes of memory, without a path
   FAULT_AT     k, from 1; 0 only counts
   FAULT_DO     self: kill this process; group: kill its group; term: end it by SIGTERM;
                terms: SIGTERM at this call and at the next two; error: this call fails;
                errors: this call and all later ones fail;
                short: from this call on each read and write moves half of its bytes;
                vanish: the file is removed before the call; grow: bytes are appended to it
   FAULT_CODE   errno of calls that fail
   FAULT_LOG    each call appends a byte to this file
   FAULT_ONCE   a file that is removed first; only the process that removes it acts
   FAULT_OF     main: calls of worker processes do not count; workers: only they do

   Calls fail only as the system lets them fail: EINTR is not an error of rename, for example, and
   a full disk still removes files. Each process reads the variables when it starts, and when it
   calls faults_begin. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum calls { NONE, CHANGE, READ, MEMORY };
/* Kinds of calls, by the errors that they can have. */
enum kind { OPEN = 1, DATA = 2, NAME = 4, REMOVE = 8, LOOK = 16 };

static char wanted[PATH_MAX], action[16], once[PATH_MAX], own_log[PATH_MAX];
static long at, count;
static size_t least;
static int code, log_fd = -1;
static volatile enum calls counted = NONE;

static const char *setting(const char *name) {
    const char *value = getenv(name);
    return value ? value : "";
}

static void copy(char *to, size_t size, const char *name) {
    snprintf(to, size, "%s", setting(name));
}

static int is_worker(void) {
    char words[4096];
    int fd = syscall(SYS_openat, AT_FDCWD, "/proc/self/cmdline", O_RDONLY | O_CLOEXEC);
    ssize_t size = fd < 0 ? 0 : syscall(SYS_read, fd, words, sizeof words);
    syscall(SYS_close, fd);
    return size > 0 && memmem(words, size, "multiprocessing", strlen("multiprocessing")) != NULL;
}

__attribute__((constructor)) void faults_begin(void) {
    counted = NONE;
    copy(wanted, sizeof wanted, "FAULT_PATH");
    copy(action, sizeof action, "FAULT_DO");
    copy(once, sizeof once, "FAULT_ONCE");
    copy(own_log, sizeof own_log, "FAULT_LOG");
    at = atol(setting("FAULT_AT"));
    code = atoi(setting("FAULT_CODE"));
    least = atol(setting("FAULT_SIZE"));
    count = 0;
    if (own_log[0])
        log_fd = syscall(SYS_openat, AT_FDCWD, own_log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC,
                         0644);
    const char *of = setting("FAULT_OF"), *calls = setting("FAULT_CALLS");
    if (of[0] && is_worker() != !strcmp(of, "workers"))
        return;
    if (!strcmp(calls, "memory"))
        counted = MEMORY;
    else if (wanted[0])
        counted = strcmp(calls, "read") ? CHANGE : READ;
}

/* Stop, and return the number of calls so far. */
long faults_end(void) {
    counted = NONE;
    return count;
}

static int can_fail(enum kind kind) {
    if (code == ENOSPC || code == EDQUOT)
        return kind != REMOVE && kind != LOOK;
    if (code == EACCES || code == EROFS)
        return kind != DATA;
    if (code == EINTR)
        return kind == OPEN || kind == DATA;
    return 1;
}

/* Count a call. Return 1 if it is to fail, 2 if it is to be short, 0 if nothing is wrong with it. */
static int meets(const char *path, enum kind kind) {
    if (log_fd >= 0)
        syscall(SYS_write, log_fd, ".", 1);
    long now = __atomic_add_fetch(&count, 1, __ATOMIC_SEQ_CST);
    if (!at || now < at)
        return 0;
    if (!strcmp(action, "errors") || (!strcmp(action, "error") && now == at)) {
        if (!can_fail(kind))
            return 0;
        errno = code;
        return 1;
    }
    if (!strcmp(action, "short"))
        return 2;
    if (!strcmp(action, "terms") && now - at < 3)
        kill(getpid(), SIGTERM);
    if (now != at || (once[0] && syscall(SYS_unlinkat, AT_FDCWD, once, 0)))
        return 0;
    if (!strcmp(action, "term")) {
        kill(getpid(), SIGTERM);
    } else if (!strcmp(action, "vanish")) {
        syscall(SYS_unlinkat, AT_FDCWD, path, 0);
    } else if (!strcmp(action, "grow")) {
        int fd = syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_APPEND | O_CLOEXEC);
        if (fd >= 0) {
            syscall(SYS_write, fd, "grown, grown, grown", 19);
            syscall(SYS_close, fd);
        }
    } else if (action[0] == 's' || (action[0] == 'g' && action[1] == 'r')) {
        kill(action[0] == 'g' ? 0 : getpid(), SIGKILL);
        for (;;)
            pause();
    }
    return 0;
}

static const char *path_of(int fd, char *found) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t size = syscall(SYS_readlinkat, AT_FDCWD, link, found, PATH_MAX - 1);
    found[size < 0 ? 0 : size] = 0;
    return found;
}

static int on_path(enum calls calls, enum kind kind, const char *path) {
    return counted == calls && path && strstr(path, wanted) ? meets(path, kind) : 0;
}

static int on_file(enum calls calls, enum kind kind, int fd) {
    char path[PATH_MAX];
    return counted == calls ? on_path(calls, kind, path_of(fd, path)) : 0;
}

/* The same for a path that may be relative to an open folder. */
static int on_path_in(enum calls calls, enum kind kind, int folder, const char *path) {
    char whole[2 * PATH_MAX + 2], start[PATH_MAX];
    if (counted != calls)
        return 0;
    if (!path || path[0] == '/' || folder == AT_FDCWD)
        return on_path(calls, kind, path);
    snprintf(whole, sizeof whole, "%s/%s", path_of(folder, start), path);
    return on_path(calls, kind, whole);
}

static size_t half(size_t size) { return size > 1 ? size / 2 : size; }

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

/* Reads and writes of bytes: SIZE is the argument that a short call halves. */
#define ON_BYTES(calls, name, declared, given, size)                                               \
    ssize_t name declared {                                                                        \
        int wrong = on_file(calls, DATA, fd);                                                      \
        if (wrong == 1)                                                                            \
            return -1;                                                                             \
        if (wrong == 2)                                                                            \
            size = half(size);                                                                     \
        return NEXT(name) given;                                                                   \
    }
ON_BYTES(CHANGE, write, (int fd, const void *data, size_t size), (fd, data, size), size)
ON_BYTES(CHANGE, pwrite, (int fd, const void *data, size_t size, off_t to), (fd, data, size, to),
         size)
ON_BYTES(CHANGE, pwrite64, (int fd, const void *data, size_t size, off64_t to),
         (fd, data, size, to), size)
ON_BYTES(READ, read, (int fd, void *data, size_t size), (fd, data, size), size)
ON_BYTES(READ, pread, (int fd, void *data, size_t size, off_t from), (fd, data, size, from), size)
ON_BYTES(READ, pread64, (int fd, void *data, size_t size, off64_t from), (fd, data, size, from),
         size)

/* Reads and writes of several parts: a short call moves half of the first. */
#define ON_PARTS(calls, name, declared, given)                                                     \
    ssize_t name declared {                                                                        \
        struct iovec first;                                                                        \
        int wrong = on_file(calls, DATA, fd);                                                      \
        if (wrong == 1)                                                                            \
            return -1;                                                                             \
        if (wrong == 2 && n > 0) {                                                                 \
            while (n > 1 && !parts->iov_len) {                                                     \
                parts++;                                                                           \
                n--;                                                                               \
            }                                                                                      \
            first = *parts;                                                                        \
            first.iov_len = half(first.iov_len);                                                   \
            parts = &first;                                                                        \
            n = 1;                                                                                 \
        }                                                                                          \
        return NEXT(name) given;                                                                   \
    }
ON_PARTS(CHANGE, writev, (int fd, const struct iovec *parts, int n), (fd, parts, n))
ON_PARTS(CHANGE, pwritev, (int fd, const struct iovec *parts, int n, off_t to), (fd, parts, n, to))
ON_PARTS(CHANGE, pwritev64, (int fd, const struct iovec *parts, int n, off64_t to),
         (fd, parts, n, to))
ON_PARTS(CHANGE, pwritev2, (int fd, const struct iovec *parts, int n, off_t to, int flags),
         (fd, parts, n, to, flags))
ON_PARTS(CHANGE, pwritev64v2, (int fd, const struct iovec *parts, int n, off64_t to, int flags),
         (fd, parts, n, to, flags))
ON_PARTS(READ, readv, (int fd, const struct iovec *parts, int n), (fd, parts, n))
ON_PARTS(READ, preadv, (int fd, const struct iovec *parts, int n, off_t from), (fd, parts, n, from))
ON_PARTS(READ, preadv64, (int fd, const struct iovec *parts, int n, off64_t from),
         (fd, parts, n, from))
ON_PARTS(READ, preadv2, (int fd, const struct iovec *parts, int n, off_t from, int flags),
         (fd, parts, n, from, flags))
ON_PARTS(READ, preadv64v2, (int fd, const struct iovec *parts, int n, off64_t from, int flags),
         (fd, parts, n, from, flags))

#define ON(condition, type, failed, name, declared, given)                                         \
    type name declared { return (condition) == 1 ? (failed) : NEXT(name) given; }
#define ON_FILE(kind, name, declared, given)                                                       \
    ON(on_file(CHANGE, kind, fd), int, -1, name, declared, given)
#define ON_PATH(kind, name, declared, given)                                                       \
    ON(on_path(CHANGE, kind, path), int, -1, name, declared, given)
#define ON_PATH_IN(kind, name, declared, given)                                                    \
    ON(on_path_in(CHANGE, kind, folder, path), int, -1, name, declared, given)
#define ON_LOOK(condition, name, declared, given) ON(condition, int, -1, name, declared, given)

ON_FILE(DATA, ftruncate, (int fd, off_t size), (fd, size))
ON_FILE(DATA, ftruncate64, (int fd, off64_t size), (fd, size))
ON_FILE(DATA, fsync, (int fd), (fd))
ON_FILE(DATA, fdatasync, (int fd), (fd))
ON_FILE(DATA, syncfs, (int fd), (fd))
ON_FILE(DATA, sync_file_range, (int fd, off64_t from, off64_t size, unsigned flags),
        (fd, from, size, flags))
ON_PATH(NAME, rename, (const char *path, const char *to), (path, to))
ON_PATH_IN(NAME, renameat, (int folder, const char *path, int other, const char *to),
           (folder, path, other, to))
ON_PATH_IN(NAME, renameat2,
           (int folder, const char *path, int other, const char *to, unsigned flags),
           (folder, path, other, to, flags))
ON(on_path(CHANGE, NAME, to), int, -1, link, (const char *path, const char *to), (path, to))
ON(on_path_in(CHANGE, NAME, other, to), int, -1, linkat,
   (int folder, const char *path, int other, const char *to, int flags),
   (folder, path, other, to, flags))
ON_PATH(NAME, mkdir, (const char *path, mode_t mode), (path, mode))
ON_PATH_IN(NAME, mkdirat, (int folder, const char *path, mode_t mode), (folder, path, mode))
ON_PATH(REMOVE, unlink, (const char *path), (path))
ON_PATH_IN(REMOVE, unlinkat, (int folder, const char *path, int flags), (folder, path, flags))
ON_PATH(REMOVE, rmdir, (const char *path), (path))

#define LOOK_AT(name, type)                                                                        \
    ON_LOOK(on_path(READ, LOOK, path), name, (const char *path, struct type *found), (path, found))
LOOK_AT(stat, stat)
LOOK_AT(stat64, stat64)
LOOK_AT(lstat, stat)
LOOK_AT(lstat64, stat64)
ON_LOOK(on_file(READ, DATA, fd), fstat, (int fd, struct stat *found), (fd, found))
ON_LOOK(on_file(READ, DATA, fd), fstat64, (int fd, struct stat64 *found), (fd, found))
ON_LOOK(on_path_in(READ, LOOK, folder, path), fstatat,
        (int folder, const char *path, struct stat *found, int flags),
        (folder, path, found, flags))
ON_LOOK(on_path_in(READ, LOOK, folder, path), fstatat64,
        (int folder, const char *path, struct stat64 *found, int flags),
        (folder, path, found, flags))
ON(on_path(READ, OPEN, path), DIR *, NULL, opendir, (const char *path), (path))
ON(on_file(READ, OPEN, fd), DIR *, NULL, fdopendir, (int fd), (fd))
ON(on_file(READ, DATA, dirfd(dir)), struct dirent *, NULL, readdir, (DIR * dir), (dir))
ON(on_file(READ, DATA, dirfd(dir)), struct dirent64 *, NULL, readdir64, (DIR * dir), (dir))

static enum calls calls_of(int flags) {
    return flags & (O_CREAT | O_WRONLY | O_RDWR) ? CHANGE : READ;
}

#define ON_OPEN(name, declared, condition, given)                                                  \
    int name declared {                                                                            \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;                    \
        va_end(rest);                                                                              \
        return (condition) == 1 ? -1 : NEXT(name) given;                                           \
    }
ON_OPEN(open, (const char *path, int flags, ...), on_path(calls_of(flags), OPEN, path),
        (path, flags, mode))
ON_OPEN(open64, (const char *path, int flags, ...), on_path(calls_of(flags), OPEN, path),
        (path, flags, mode))
ON_OPEN(openat, (int folder, const char *path, int flags, ...),
        on_path_in(calls_of(flags), OPEN, folder, path), (folder, path, flags, mode))
ON_OPEN(openat64, (int folder, const char *path, int flags, ...),
        on_path_in(calls_of(flags), OPEN, folder, path), (folder, path, flags, mode))

#define ON_STREAM(name)                                                                            \
    ON(on_path(mode[0] == 'r' && !strchr(mode, '+') ? READ : CHANGE, OPEN, path), FILE *, NULL,   \
       name, (const char *path, const char *mode), (path, mode))
ON_STREAM(fopen)
ON_STREAM(fopen64)

/* Memory: without dlsym, which requests some itself. */
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t),
    *__libc_memalign(size_t, size_t);

static int lacks(size_t size) {
    if (counted != MEMORY || size < least)
        return 0;
    return meets("", DATA) == 1;
}

void *malloc(size_t size) { return lacks(size) ? NULL : __libc_malloc(size); }
void *calloc(size_t n, size_t size) { return lacks(n * size) ? NULL : __libc_calloc(n, size); }
void *realloc(void *old, size_t size) { return lacks(size) ? NULL : __libc_realloc(old, size); }
void *aligned_alloc(size_t to, size_t size) { return lacks(size) ? NULL : __libc_memalign(to, size); }
int posix_memalign(void **found, size_t to, size_t size) {
    if (lacks(size))
        return ENOMEM;
    *found = __libc_memalign(to, size);
    return *found ? 0 : ENOMEM;
}

static void *map(void *place, size_t size, int kind, int flags, int fd, off64_t from) {
    if ((flags & MAP_ANONYMOUS ? lacks(size) : on_file(READ, DATA, fd) == 1)) {
        if (flags & MAP_ANONYMOUS)
            errno = ENOMEM;
        return MAP_FAILED;
    }
    return (void *)syscall(SYS_mmap, place, size, kind, flags, fd, from);
}
void *mmap(void *place, size_t size, int kind, int flags, int fd, off_t from) {
    return map(place, size, kind, flags, fd, from);
}
void *mmap64(void *place, size_t size, int kind, int flags, int fd, off64_t from) {
    return map(place, size, kind, flags, fd, from);
}
