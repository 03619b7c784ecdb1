// A wall clock that a test moves. Loaded before the C library, it adds to CLOCK_REALTIME the seconds that the file named
// by CLOCK_OFFSET holds at that moment. Every other clock, CLOCK_MONOTONIC above all, is left alone.

#include <cstdlib>
#include <fcntl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
  static const int file = open(getenv("CLOCK_OFFSET"), O_RDONLY | O_CLOEXEC);
  const long code = syscall(SYS_clock_gettime, clock, time);
  char text[32] = {};
  if (clock == CLOCK_REALTIME && pread(file, text, sizeof text - 1, 0) > 0) time->tv_sec += atol(text);
  return code;
}

// OpenSSL's.
extern "C" time_t time(time_t* to) noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (to) *to = now.tv_sec;
  return now.tv_sec;
}
