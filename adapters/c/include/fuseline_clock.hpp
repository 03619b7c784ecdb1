// Clocks that are objects, for C++17, header only, over fuseline.hpp. Give one to an operator after the clouds; it must live
// longer than the operator, and one thread reads it.
//
//   fuseline::ReadClock clock([&] { return std::chrono::nanoseconds(node.now().nanoseconds()); });
//   fuseline::Operator<Boxes, Planner, fuseline::C3W16, decltype(clock)> op(planner, 16, Commit::eager, 1s, {{cloud, 31}}, clock);

#ifndef FUSELINE_CLOCK_HPP
#define FUSELINE_CLOCK_HPP

#include "fuseline.hpp"

#include <type_traits>
#include <utility>

namespace fuseline {

// A clock of your own, such as simulated time or a synchronised clock. `read` returns how long it has run,
// as a std::chrono duration that counts in 64 bits. A reading before its start becomes 0.
//
// If a reading is earlier than a previous one, the clock returns the previous one instead, and counts
// that. No timer fires until the clock has caught up. If the clock was set back by more than a deadline,
// for example when a recording starts again, make a new operator.
template <class Read>
class ReadClock {
  template <class>
  struct IsDuration : std::false_type {};
  template <class Rep, class Period>
  struct IsDuration<std::chrono::duration<Rep, Period>> : std::true_type {
    static constexpr bool is_wide = std::is_integral_v<Rep> && sizeof(Rep) >= sizeof(std::int64_t);
  };
  using Given = std::decay_t<std::invoke_result_t<Read&>>;
  static_assert(IsDuration<Given>::value, "a clock is read as a std::chrono::duration since its start, which has a unit");

 public:
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<ReadClock>;
  static constexpr bool is_steady = true;

  explicit ReadClock(Read read) : read_(std::move(read)) {
    static_assert(IsDuration<Given>::is_wide, "a clock counts in whole numbers of 64 bits: fewer wrap, and others are rounded");
  }
  ReadClock(const ReadClock&) = delete;
  ReadClock& operator=(const ReadClock&) = delete;

  time_point now() {
    constexpr auto greatest = static_cast<std::uint64_t>(duration::max().count());
    const std::uint64_t ns = nanoseconds_of(read_());
    const duration reading(static_cast<rep>(ns < greatest ? ns : greatest));
    if (reading < latest_) {
      ++set_back_;
    } else {
      latest_ = reading;
    }
    return time_point(latest_);
  }

  // Returns the number of readings that were earlier than a previous one.
  std::uint64_t set_back() const noexcept { return set_back_; }

 private:
  Read read_;
  duration latest_{};
  std::uint64_t set_back_ = 0;
};

template <class Read>
ReadClock(Read) -> ReadClock<Read>;

// A clock for tests and simulations. Its time passes only by advance().
class ManualClock {
 public:
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<ManualClock>;
  static constexpr bool is_steady = true;

  ManualClock() = default;
  ManualClock(const ManualClock&) = delete;
  ManualClock& operator=(const ManualClock&) = delete;

  time_point now() const noexcept { return time_point(at_); }

  // Lets time pass. Returns false, and changes nothing, if `by` is negative or leads beyond the last reading.
  template <class Rep, class Period>
  [[nodiscard]] bool advance(const std::chrono::duration<Rep, Period>& by) noexcept {
    const auto left = static_cast<std::uint64_t>((duration::max() - at_).count());
    const std::uint64_t ns = nanoseconds_of(by);
    if (!(by.count() >= Rep{}) || ns > left) return false;
    at_ += duration(static_cast<rep>(ns));
    return true;
  }

 private:
  duration at_{};
};

}  // namespace fuseline

#endif  // FUSELINE_CLOCK_HPP
