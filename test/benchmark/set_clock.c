/* Sets the clock of the processes that preload it: ahead by the nanoseconds in the file CLOCK_FILE,
 * in all of them at once. Their steady clock stays, and so do waits that count on either. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define NS 1000000000LL
#define REAL(name, version) static __typeof__(name) *real; \
    if (!real) real = dlvsym(RTLD_NEXT, #name, version)

static const volatile int64_t *ahead;

__attribute__((constructor)) static void begin(void) {
    int file = open(getenv("CLOCK_FILE"), O_RDONLY);
    void *at = mmap(NULL, sizeof(*ahead), PROT_READ, MAP_SHARED, file, 0);
    ahead = at == MAP_FAILED ? NULL : at;
    close(file);
}

static struct timespec shifted(struct timespec at, int sign) {
    int64_t ns = at.tv_sec * NS + at.tv_nsec + (ahead ? sign * *ahead : 0);
    return (struct timespec){ns / NS, ns % NS};
}

/* A deadline of the steady clock is a time since the start of the machine. */
static struct timespec due(const struct timespec *at) {
    return at->tv_sec > NS ? shifted(*at, -1) : *at;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    REAL(clock_gettime, "GLIBC_2.17");
    int failed = real(clock, now);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        *now = shifted(*now, 1);
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec at;
    clock_gettime(CLOCK_REALTIME, &at);
    *now = (struct timeval){at.tv_sec, at.tv_nsec / 1000};
    return 0;
}

time_t time(time_t *now) {
    struct timespec at;
    clock_gettime(CLOCK_REALTIME, &at);
    return now ? (*now = at.tv_sec) : at.tv_sec;
}

int pthread_cond_timedwait(pthread_cond_t *restrict one, pthread_mutex_t *restrict lock,
                           const struct timespec *restrict at) {
    REAL(pthread_cond_timedwait, "GLIBC_2.3.2");
    struct timespec then = due(at);
    return real(one, lock, &then);
}

int sem_timedwait(sem_t *restrict one, const struct timespec *restrict at) {
    REAL(sem_timedwait, "GLIBC_2.34");
    struct timespec then = due(at);
    return real(one, &then);
}
