// Joins for C++17, header only, without the library. A join collects messages of several inputs that share a key into a
// set (E5, E6, E8).
//
// A join resembles the synchronizers of message_filters, but it bounds the wait and reports drops, so a dead sensor
// delays a set only by that bound. It serves one thread. Time is an argument: call tick() at next_due(), for example
// from a timer of rclcpp.

#ifndef FUSELINE_JOIN_HPP
#define FUSELINE_JOIN_HPP

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

namespace fuseline {

// The reason why a set was given: every input is there, its wait ended, or another set needed its room.
enum class JoinCause { complete, due, full };

// The reason why a message was not joined. `late`: its set was already given, or is older than the last
// 1,024 sets. `duplicate`: its input's message is already in the set. `null`: its pointer is null.
enum class JoinDropReason { late, duplicate, null };

// A set. The pointer of an input that contributed no message is null.
template <class... Messages>
struct JoinedSet {
  std::uint64_t key;
  std::tuple<std::shared_ptr<const Messages>...> messages;
  JoinCause cause;
};

// A message that was not joined. Inputs count from 0.
struct JoinDrop {
  std::size_t input;
  std::uint64_t key;
  JoinDropReason why;
};

template <class... Messages>
class Join {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  using Set = JoinedSet<Messages...>;
  template <std::size_t Input>
  using Message = std::tuple_element_t<Input, std::tuple<Messages...>>;

  // Creates a join whose sets wait for `wait` after their first message. At most `window` sets (at
  // least 1) may wait. If another set begins, the oldest is given incomplete.
  //
  // Callbacks may call the join, and may throw. The sets that are due are still given, and the message that
  // came is still joined. Then the outermost call throws the first exception. Without `on_drop`, drops are
  // only counted.
  Join(std::chrono::nanoseconds wait, std::size_t window, std::function<void(const Set&)> on_set,
       std::function<void(const JoinDrop&)> on_drop)
      : wait_(wait), window_(std::max<std::size_t>(window, 1)), on_set_(std::move(on_set)), on_drop_(std::move(on_drop)) {}

  // A join that is destroyed within a call of its own, for example by a callback, ends the program.
  ~Join() {
    if (calls_ > 0) std::terminate();
  }
  Join(const Join&) = delete;
  Join& operator=(const Join&) = delete;

  // Adds a message. The messages of one set share a key, such as their stamp.
  template <std::size_t Input>
  void arrive(Instant now, std::uint64_t key, std::shared_ptr<const Message<Input>> message) {
    call([&] { take<Input>(now, key, std::move(message)); });
  }

  // Gives the sets that are due, the oldest first (E5).
  void tick(Instant now) {
    call([&] { give_due(now); });
  }

  // Returns the number of messages that were dropped.
  std::uint64_t dropped() const noexcept { return dropped_; }

  // Returns the instant when the next set is due, if one waits.
  [[nodiscard]] std::optional<Instant> next_due() const {
    if (open_.empty()) return std::nullopt;
    return open_.at(oldest()).due;
  }

 private:
  struct OpenSet {
    Instant due;
    std::tuple<std::shared_ptr<const Messages>...> messages;
  };

  template <std::size_t Input>
  void take(Instant now, std::uint64_t key, std::shared_ptr<const Message<Input>> message) {
    give_due(now);
    if (!message) return drop({Input, key, JoinDropReason::null});
    // A key that was given never opens again (E6).
    if ((floor_ && key <= *floor_) || given_.count(key) > 0) return drop({Input, key, JoinDropReason::late});
    if (open_.count(key) == 0 && open_.size() >= window_) give(oldest(), JoinCause::full);
    OpenSet& open = open_.try_emplace(key, OpenSet{due_at(now), {}}).first->second;
    auto& place = std::get<Input>(open.messages);
    if (place) return drop({Input, key, JoinDropReason::duplicate});
    place = std::move(message);
    const bool is_complete = std::apply([](const auto&... each) { return (... && bool(each)); }, open.messages);
    if (is_complete) return give(key, JoinCause::complete);
    give_due(now);
  }

  void give_due(Instant now) {
    while (!open_.empty() && open_.at(oldest()).due <= now) give(oldest(), JoinCause::due);
  }

  Instant due_at(Instant now) const { return wait_ > Instant::duration::zero() && now > Instant::max() - wait_ ? Instant::max() : now + wait_; }

  std::uint64_t oldest() const {
    const auto earlier = [](const auto& one, const auto& other) { return one.second.due < other.second.due; };
    return std::min_element(open_.begin(), open_.end(), earlier)->first;
  }

  void give(std::uint64_t key, JoinCause cause) {
    const auto open = open_.extract(key);
    given_.insert(key);
    // The keys that are remembered are bounded (E8).
    if (given_.size() > remembered) {
      floor_ = std::max(floor_.value_or(0), *given_.begin());
      given_.erase(given_.begin());
    }
    attempt([&] { on_set_({key, open.mapped().messages, cause}); });
  }

  void drop(const JoinDrop& dropped) {
    ++dropped_;
    if (on_drop_) attempt([&] { on_drop_(dropped); });
  }

  // Runs a call. It throws what callbacks threw, unless another call is under way.
  template <class Function>
  void call(Function function) {
    struct Call {
      unsigned& calls;
      ~Call() { --calls; }
    };
    {
      ++calls_;
      const Call one{calls_};
      function();
    }
#if defined(__cpp_exceptions)
    if (calls_ == 0 && thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
#endif
  }

  // Calls a callback, and keeps the first exception.
  template <class Function>
  void attempt(Function function) {
#if defined(__cpp_exceptions)
    try {
      function();
    } catch (...) {
      const std::exception_ptr now = std::current_exception();
      if (!now) throw;  // the thread is cancelled, or exits
      if (!thrown_) thrown_ = now;
    }
#else
    function();
#endif
  }

  static constexpr std::size_t remembered = 1024;
  std::chrono::nanoseconds wait_;
  std::size_t window_;
  std::function<void(const Set&)> on_set_;
  std::function<void(const JoinDrop&)> on_drop_;
  std::map<std::uint64_t, OpenSet> open_;
  std::set<std::uint64_t> given_;
  std::optional<std::uint64_t> floor_;
  std::uint64_t dropped_ = 0;
  unsigned calls_ = 0;
  std::exception_ptr thrown_;
};

}  // namespace fuseline

#endif  // FUSELINE_JOIN_HPP
