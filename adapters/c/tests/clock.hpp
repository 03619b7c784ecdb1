// Shared by the programs in C++.
#ifndef FUSELINE_TESTS_CLOCK_HPP
#define FUSELINE_TESTS_CLOCK_HPP

#include <chrono>

// A clock that counts in `Duration`. A test sets its reading.
template <class Duration>
struct SetClock {
  using duration = Duration;
  using rep = typename Duration::rep;
  using period = typename Duration::period;
  using time_point = std::chrono::time_point<SetClock>;
  static constexpr bool is_steady = true;
  static time_point now() noexcept { return time_point(at); }
  static inline duration at{};
};

#endif  // FUSELINE_TESTS_CLOCK_HPP
