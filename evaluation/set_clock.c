/* The computer's clock as the processes see it that load this library (LD_PRELOAD): ahead of what it is by as many
   nanoseconds as stand in the file SET_CLOCK, eight bytes that others may change at any time. The clocks that nobody can
   set stay as they are. Who waits until a time of day waits by the same clock: its own is that of the kernel, which would
   let it wait for hours, or not at all. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define OF_THE_DAY 1000000000LL /* seconds: later than any computer is awake */

static const volatile int64_t none = 0;
static const volatile int64_t *ahead = &none;

__attribute__((constructor)) static void begin(void) {
  const char *name = getenv("SET_CLOCK");
  int file = name ? open(name, O_RDONLY | O_CLOEXEC) : -1;
  if (file < 0) return;
  void *page = mmap(NULL, sizeof *ahead, PROT_READ, MAP_SHARED, file, 0);
  if (page != MAP_FAILED) ahead = page;
  close(file);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
  int failed = syscall(SYS_clock_gettime, clock, now);
  if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) {
    int64_t told = now->tv_sec * SECOND + now->tv_nsec + *ahead;
    now->tv_sec = told / SECOND;
    now->tv_nsec = told % SECOND;
  }
  return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
  struct timespec told;
  (void)zone;
  clock_gettime(CLOCK_REALTIME, &told);
  now->tv_sec = told.tv_sec;
  now->tv_usec = told.tv_nsec / 1000;
  return 0;
}

time_t time(time_t *now) {
  struct timespec told;
  clock_gettime(CLOCK_REALTIME, &told);
  if (now) *now = told.tv_sec;
  return told.tv_sec;
}

/* The time of day `told` as the kernel knows it; a time by another clock as it is. */
static struct timespec real(const struct timespec *told) {
  if (told->tv_sec < OF_THE_DAY) return *told;
  int64_t due = told->tv_sec * SECOND + told->tv_nsec - *ahead;
  struct timespec time = {due / SECOND, due % SECOND};
  return time;
}

int pthread_cond_timedwait(pthread_cond_t *restrict changed, pthread_mutex_t *restrict lock,
                           const struct timespec *restrict until) {
  static int (*wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
  if (!wait) *(void **)&wait = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
  struct timespec due = real(until);
  return wait(changed, lock, &due);
}

int pthread_cond_clockwait(pthread_cond_t *changed, pthread_mutex_t *lock, clockid_t clock,
                           const struct timespec *until) {
  static int (*wait)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
  if (!wait) *(void **)&wait = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
  struct timespec due = real(until);
  return wait(changed, lock, clock, &due);
}

int pthread_mutex_timedlock(pthread_mutex_t *lock, const struct timespec *until) {
  static int (*wait)(pthread_mutex_t *, const struct timespec *);
  if (!wait) *(void **)&wait = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
  struct timespec due = real(until);
  return wait(lock, &due);
}

int sem_timedwait(sem_t *restrict free, const struct timespec *restrict until) {
  static int (*wait)(sem_t *, const struct timespec *);
  if (!wait) *(void **)&wait = dlsym(RTLD_NEXT, "sem_timedwait");
  struct timespec due = real(until);
  return wait(free, &due);
}
