// SPDX-FileCopyrightText: The kitti_ros2 authors
// SPDX-License-Identifier: Apache-2.0
//
// Preloaded into a process: records in WATCH_LOG what it changes below WATCH_ROOT, in order. A line
// is a letter and fields with tabs between them; directories and files are named by inode:
//   C dir name ino kind    created (kind f or d)        W ino         written or truncated
//   R dir name dir name    renamed                      X the same    exchanged
//   L dir name ino         linked                       U dir name    removed
//   F ino copy             synced, with the name of a copy of its content in WATCH_COPIES
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#define MOST_FILES 65536
#define REAL(name) ((__typeof__(&name))real(#name))

static const char *root, *copies;
static int log_file = -1;
static char watched[MOST_FILES];
static atomic_int copied;

// Held from a change of names to its line: another thread that finds the folder there, as mkdir with
// EEXIST does, must not write the line of what is in it first.
static pthread_mutex_t order = PTHREAD_MUTEX_INITIALIZER;

static void *real(const char *name) { return dlsym(RTLD_NEXT, name); }

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("WATCH_LOG");
    root = getenv("WATCH_ROOT");
    copies = getenv("WATCH_COPIES");
    if (path && root && copies)
        log_file = syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
    // Out of the way of programs that close or count low descriptors.
    int high = fcntl(log_file, F_DUPFD_CLOEXEC, 1000);
    if (high >= 0) log_file = high;
}

static void note(const char *format, ...) {
    char line[PATH_MAX * 2];
    int saved = errno;
    va_list parts;
    va_start(parts, format);
    int size = vsnprintf(line, sizeof line, format, parts);
    va_end(parts);
    if (size > 0 && syscall(SYS_write, log_file, line, size) != size) abort();
    errno = saved;
}

static int is_below(const char *path) {
    size_t size = strlen(root);
    return !strncmp(path, root, size) && (path[size] == '/' || !path[size]);
}

struct place { ino_t folder; char name[NAME_MAX + 1]; };

// The folder and name of a path, if it is below the root.
static int place_of(int at, const char *path, struct place *place) {
    char full[PATH_MAX], copy[PATH_MAX], folder[PATH_MAX];
    struct stat status;
    int saved = errno, found = 0;
    if (log_file < 0) return 0;
    if (path[0] == '/' || at == AT_FDCWD) snprintf(full, sizeof full, "%s", path);
    else snprintf(full, sizeof full, "/proc/self/fd/%d/%s", at, path);
    strcpy(copy, full);
    if (realpath(dirname(copy), folder) && is_below(folder) && !stat(folder, &status)) {
        strcpy(copy, full);
        place->folder = status.st_ino;
        snprintf(place->name, sizeof place->name, "%s", basename(copy));
        found = 1;
    }
    errno = saved;
    return found;
}

static ino_t inode(int at, const char *path) {
    struct stat status;
    int saved = errno;
    ino_t found = fstatat(at, path, &status, AT_SYMLINK_NOFOLLOW) ? 0 : status.st_ino;
    errno = saved;
    return found;
}

static void written(int file) {
    struct stat status;
    if (log_file < 0 || file < 0 || file >= MOST_FILES || !watched[file]) return;
    int saved = errno;
    if (!fstat(file, &status)) note("W\t%lu\n", status.st_ino);
    errno = saved;
}

static int open_in_order(int at, const char *path, int flags, mode_t mode) {
    struct place place;
    struct stat status;
    int below = place_of(at, path, &place);
    int existed = below && inode(at, path);
    int file = syscall(SYS_openat, at, path, flags, mode);
    if (file < 0 || file >= MOST_FILES) return file;
    watched[file] = 0;
    if (!below || fstat(file, &status) || !S_ISREG(status.st_mode)) return file;
    watched[file] = 1;
    if (!existed) note("C\t%lu\t%s\t%lu\tf\n", place.folder, place.name, status.st_ino);
    else if (flags & O_TRUNC) note("W\t%lu\n", status.st_ino);
    return file;
}

static int opened(int at, const char *path, int flags, mode_t mode) {
    if (!(flags & O_CREAT)) return open_in_order(at, path, flags, mode);
    pthread_mutex_lock(&order);
    int file = open_in_order(at, path, flags, mode);
    pthread_mutex_unlock(&order);
    return file;
}

#define MODE(last) \
    mode_t mode = 0; \
    if (flags & (O_CREAT | __O_TMPFILE)) { \
        va_list rest; \
        va_start(rest, last); \
        mode = va_arg(rest, mode_t); \
        va_end(rest); \
    }

int open(const char *path, int flags, ...) { MODE(flags) return opened(AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE(flags) return opened(AT_FDCWD, path, flags, mode); }
int openat(int at, const char *path, int flags, ...) { MODE(flags) return opened(at, path, flags, mode); }
int openat64(int at, const char *path, int flags, ...) { MODE(flags) return opened(at, path, flags, mode); }

// After the call: a copy that fsync made of an earlier state is never taken for a later one.
#define WRITES(kind, name, arguments, ...) \
    kind name arguments { \
        kind result = REAL(name)(__VA_ARGS__); \
        written(file); \
        return result; \
    }
WRITES(ssize_t, write, (int file, const void *data, size_t size), file, data, size)
WRITES(ssize_t, pwrite, (int file, const void *data, size_t size, off_t at), file, data, size, at)
WRITES(ssize_t, pwrite64, (int file, const void *data, size_t size, off64_t at), file, data, size, at)
WRITES(ssize_t, writev, (int file, const struct iovec *data, int count), file, data, count)
WRITES(ssize_t, pwritev, (int file, const struct iovec *data, int count, off_t at), file, data, count, at)
WRITES(ssize_t, pwritev64, (int file, const struct iovec *data, int count, off64_t at), file, data, count, at)
WRITES(ssize_t, pwritev2, (int file, const struct iovec *data, int count, off_t at, int flags), file, data, count, at, flags)
WRITES(ssize_t, pwritev64v2, (int file, const struct iovec *data, int count, off64_t at, int flags), file, data, count, at, flags)
WRITES(int, ftruncate, (int file, off_t size), file, size)
WRITES(int, ftruncate64, (int file, off64_t size), file, size)
WRITES(ssize_t, sendfile, (int file, int from, off_t *at, size_t size), file, from, at, size)
WRITES(ssize_t, sendfile64, (int file, int from, off64_t *at, size_t size), file, from, at, size)

static void copy_to(int file, const char *path) {
    char own[64], buffer[65536];
    ssize_t size;
    snprintf(own, sizeof own, "/proc/self/fd/%d", file);
    int from = syscall(SYS_openat, AT_FDCWD, own, O_RDONLY | O_CLOEXEC);
    int to = syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    while ((size = syscall(SYS_read, from, buffer, sizeof buffer)) > 0)
        if (syscall(SYS_write, to, buffer, size) != size) abort();
    syscall(SYS_close, from);
    syscall(SYS_close, to);
}

static void synced(int file) {
    struct stat status;
    char own[64], path[PATH_MAX], name[64];
    int saved = errno;
    if (log_file < 0 || fstat(file, &status)) { errno = saved; return; }
    snprintf(own, sizeof own, "/proc/self/fd/%d", file);
    ssize_t size = readlink(own, path, sizeof path - 1);
    if (size > 0 && (path[size] = 0, is_below(path))) {
        if (S_ISDIR(status.st_mode)) note("F\t%lu\t\n", status.st_ino);
        else {
            snprintf(name, sizeof name, "%d-%d", getpid(), atomic_fetch_add(&copied, 1));
            snprintf(path, sizeof path, "%s/%s", copies, name);
            copy_to(file, path);
            note("F\t%lu\t%s\n", status.st_ino, name);
        }
    }
    errno = saved;
}

int fsync(int file) {
    int result = REAL(fsync)(file);
    if (!result) synced(file);
    return result;
}

int fdatasync(int file) {
    int result = REAL(fdatasync)(file);
    if (!result) synced(file);
    return result;
}

static int moved(int from_at, const char *from, int to_at, const char *to, unsigned flags) {
    struct place old, new;
    int below = place_of(from_at, from, &old) & place_of(to_at, to, &new);
    pthread_mutex_lock(&order);
    int result = syscall(SYS_renameat2, from_at, from, to_at, to, flags);
    if (!result && below)
        note("%c\t%lu\t%s\t%lu\t%s\n", flags & RENAME_EXCHANGE ? 'X' : 'R', old.folder, old.name, new.folder, new.name);
    pthread_mutex_unlock(&order);
    return result;
}

int rename(const char *from, const char *to) { return moved(AT_FDCWD, from, AT_FDCWD, to, 0); }
int renameat(int a, const char *from, int b, const char *to) { return moved(a, from, b, to, 0); }
int renameat2(int a, const char *from, int b, const char *to, unsigned flags) { return moved(a, from, b, to, flags); }

int mkdirat(int at, const char *path, mode_t mode) {
    struct place place;
    int below = place_of(at, path, &place);
    pthread_mutex_lock(&order);
    int result = syscall(SYS_mkdirat, at, path, mode);
    if (!result && below) note("C\t%lu\t%s\t%lu\td\n", place.folder, place.name, inode(at, path));
    pthread_mutex_unlock(&order);
    return result;
}

int mkdir(const char *path, mode_t mode) { return mkdirat(AT_FDCWD, path, mode); }

int unlinkat(int at, const char *path, int flags) {
    struct place place;
    int below = place_of(at, path, &place);
    pthread_mutex_lock(&order);
    int result = syscall(SYS_unlinkat, at, path, flags);
    if (!result && below) note("U\t%lu\t%s\n", place.folder, place.name);
    pthread_mutex_unlock(&order);
    return result;
}

int unlink(const char *path) { return unlinkat(AT_FDCWD, path, 0); }
int rmdir(const char *path) { return unlinkat(AT_FDCWD, path, AT_REMOVEDIR); }

int linkat(int a, const char *from, int b, const char *to, int flags) {
    struct place place;
    int below = place_of(b, to, &place);
    pthread_mutex_lock(&order);
    int result = syscall(SYS_linkat, a, from, b, to, flags);
    if (!result && below) note("L\t%lu\t%s\t%lu\n", place.folder, place.name, inode(b, to));
    pthread_mutex_unlock(&order);
    return result;
}

int link(const char *from, const char *to) { return linkat(AT_FDCWD, from, AT_FDCWD, to, 0); }
