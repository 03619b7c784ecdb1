// Joins for C++17, header only, without the library: messages of several inputs that have one key, given together (E5, E6, E8).
//
// As the synchronizers of message_filters, with a bound on waiting and a callback on drops: a sensor that died holds nothing
// up. For one thread. Time is an argument: call tick() at next_due(), for instance by a timer of rclcpp.

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

// Why a set was given: each input is there, its wait was over, or there was no room for a new one.
enum class JoinCause { complete, due, full };

// Why a message was not joined: its set was given before, or is older than the last 1,024 that were; its input's message is
// there; its pointer is null.
enum class JoinDropReason { late, duplicate, null };

// A set; the pointer of an input that nothing came from is null.
template <class... Messages>
struct JoinedSet {
  std::uint64_t key;
  std::tuple<std::shared_ptr<const Messages>...> messages;
  JoinCause cause;
};

// A message that was not joined; inputs count from 0.
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

  // A set waits so long after its first message; for one more than `window`, of at least 1, the oldest is given as it is.
  //
  // Callbacks may call the join, and may throw: what is due is given first, and the message that came is taken. Then the first
  // exception is thrown, by the outermost call. Without `on_drop`, drops are only counted.
  Join(std::chrono::nanoseconds wait, std::size_t window, std::function<void(const Set&)> on_set,
       std::function<void(const JoinDrop&)> on_drop)
      : wait_(wait), window_(std::max<std::size_t>(window, 1)), on_set_(std::move(on_set)), on_drop_(std::move(on_drop)) {}

  // The end of a join within a call of its own, as by a callback, ends the program.
  ~Join() {
    if (calls_ > 0) std::terminate();
  }
  Join(const Join&) = delete;
  Join& operator=(const Join&) = delete;

  // A message came. The key is what the messages of one set have in common, such as their stamp.
  template <std::size_t Input>
  void arrive(Instant now, std::uint64_t key, std::shared_ptr<const Message<Input>> message) {
    call([&] { take<Input>(now, key, std::move(message)); });
  }

  // E5: gives what is due, the oldest first.
  void tick(Instant now) {
    call([&] { give_due(now); });
  }

  // How many messages were dropped.
  std::uint64_t dropped() const noexcept { return dropped_; }

  // When the next set is due, if one waits.
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
    // E6 once: a key that was given never opens again.
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
    // E8 bounded.
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

  // A call, which throws what callbacks threw unless another call is under way.
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
