/* SPDX-FileCopyrightText: The kitti_ros2 authors
   SPDX-License-Identifier: Apache-2.0

   A library to preload: at the k-th call that changes a file whose path contains a text, it kills
   a process or a group, or lets this call and all later ones fail as on a full disk.

   FAULT_PATH  the text
   FAULT_AT    k, from 1; 0 only counts
   FAULT_DO    self: kill this process; group: kill its group; full: fail with ENOSPC; readonly: EROFS
   FAULT_LOG   each call appends a byte to this file
   FAULT_ONCE  a file that is removed first; only the process that removes it acts
   FAULT_OF    main: calls of worker processes do not count; workers: only they do */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char wanted[PATH_MAX], action[16], once[PATH_MAX];
static long at, count;
static int log_fd = -1;

static void copy(char *to, size_t size, const char *name) {
    const char *value = getenv(name);
    snprintf(to, size, "%s", value ? value : "");
}

static int is_worker(void) {
    char words[4096];
    int fd = syscall(SYS_openat, AT_FDCWD, "/proc/self/cmdline", O_RDONLY | O_CLOEXEC);
    ssize_t size = fd < 0 ? 0 : read(fd, words, sizeof words);
    close(fd);
    return size > 0 && memmem(words, size, "multiprocessing", strlen("multiprocessing")) != NULL;
}

__attribute__((constructor)) static void begin(void) {
    copy(wanted, sizeof wanted, "FAULT_PATH");
    copy(action, sizeof action, "FAULT_DO");
    copy(once, sizeof once, "FAULT_ONCE");
    at = getenv("FAULT_AT") ? atol(getenv("FAULT_AT")) : 0;
    if (getenv("FAULT_LOG"))
        log_fd = syscall(SYS_openat, AT_FDCWD, getenv("FAULT_LOG"),
                         O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    const char *of = getenv("FAULT_OF");
    if (of && is_worker() != !strcmp(of, "workers"))
        wanted[0] = 0;
}

/* Return whether this call is to fail. */
static int meets(const char *path) {
    if (!wanted[0] || !strstr(path, wanted))
        return 0;
    if (log_fd >= 0)
        syscall(SYS_write, log_fd, ".", 1);
    long now = __atomic_add_fetch(&count, 1, __ATOMIC_SEQ_CST);
    if (!at || now < at)
        return 0;
    if (!strcmp(action, "full") || !strcmp(action, "readonly")) {
        errno = action[0] == 'f' ? ENOSPC : EROFS;
        return 1;
    }
    if (now != at || (once[0] && syscall(SYS_unlinkat, AT_FDCWD, once, 0)))
        return 0;
    kill(action[0] == 'g' ? 0 : getpid(), SIGKILL);
    for (;;)
        pause();
}

static const char *path_of(int fd, char *found) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t size = readlink(link, found, PATH_MAX - 1);
    found[size < 0 ? 0 : size] = 0;
    return found;
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define ON_FILE(type, name, declared, given)                                                       \
    type name declared {                                                                           \
        char path[PATH_MAX];                                                                       \
        return meets(path_of(fd, path)) ? -1 : NEXT(name) given;                                   \
    }
#define ON_PATH(name, declared, given)                                                             \
    int name declared { return meets(path) ? -1 : NEXT(name) given; }

ON_FILE(ssize_t, write, (int fd, const void *data, size_t size), (fd, data, size))
ON_FILE(ssize_t, writev, (int fd, const struct iovec *parts, int n), (fd, parts, n))
ON_FILE(ssize_t, pwrite, (int fd, const void *data, size_t size, off_t to), (fd, data, size, to))
ON_FILE(ssize_t, pwrite64, (int fd, const void *data, size_t size, off64_t to),
        (fd, data, size, to))
ON_FILE(ssize_t, pwritev, (int fd, const struct iovec *parts, int n, off_t to), (fd, parts, n, to))
ON_FILE(ssize_t, pwritev64, (int fd, const struct iovec *parts, int n, off64_t to),
        (fd, parts, n, to))
ON_FILE(int, ftruncate, (int fd, off_t size), (fd, size))
ON_FILE(int, ftruncate64, (int fd, off64_t size), (fd, size))
ON_FILE(int, fsync, (int fd), (fd))
ON_FILE(int, fdatasync, (int fd), (fd))
ON_PATH(rename, (const char *path, const char *to), (path, to))
ON_PATH(unlink, (const char *path), (path))
ON_PATH(mkdir, (const char *path, mode_t mode), (path, mode))
ON_PATH(rmdir, (const char *path), (path))

#define ON_OPEN(name)                                                                              \
    int name(const char *path, int flags, ...) {                                                   \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;                    \
        va_end(rest);                                                                              \
        if (flags & (O_CREAT | O_WRONLY | O_RDWR) && meets(path))                                  \
            return -1;                                                                             \
        return NEXT(name)(path, flags, mode);                                                      \
    }
ON_OPEN(open)
ON_OPEN(open64)
