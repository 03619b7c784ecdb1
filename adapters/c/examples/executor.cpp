// The same on an executor with topics and timers, as rclcpp has it, without ROS: callbacks of one thread, one node that
// subscribes, publishes and arms a timer for the next due instant. The clock is the executor's own and simulated, so
// that the run is the same each time.
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "fuseline.hpp"
#include "fuseline_clock.hpp"

using namespace std::chrono_literals;
using fuseline::Priority;
using fuseline::Timestamp;

// --- as much of an executor as the node below needs -----------------------------------------------------------------

class Executor {
 public:
  using Callback = std::function<void()>;
  using Clock = fuseline::ManualClock;
  Clock clock;
  // Calls back at an instant; of equal ones in the order of the calls here.
  void call_at(Clock::time_point at, Callback callback) { due_.emplace(at, std::move(callback)); }
  void call_after(Clock::duration after, Callback callback) { call_at(clock.now() + after, std::move(callback)); }
  void spin() {
    while (!due_.empty()) {
      auto next = due_.extract(due_.begin());
      // An overdue callback is called at once: the clock does not go back.
      static_cast<void>(clock.advance(next.key() - clock.now()));
      next.mapped()();
    }
  }

 private:
  std::multimap<Clock::time_point, Callback> due_;
};

// --- the node ---------------------------------------------------------------------------------------------------------

struct Boxes {
  std::string of;
};
using Message = std::unique_ptr<Boxes>;  // moved from the model to the topic, never copied

struct Topic : fuseline::Sink<Message> {
  Executor& executor;
  explicit Topic(Executor& given) : executor(given) {}
  unsigned published = 0, cancelled = 0;
  void forward(Timestamp t, Priority, Message boxes) {
    ++published;
    std::printf("%5.1f ms  /boxes  %llu  %s\n", std::chrono::duration<double, std::milli>(executor.clock.now().time_since_epoch()).count(),
                static_cast<unsigned long long>(t.count), boxes->of.c_str());
  }
  void miss(Timestamp t) { std::printf("          /boxes  %llu  missed\n", static_cast<unsigned long long>(t.count)); }
  void cancel(Timestamp, Priority) { ++cancelled; }
};

class DetectorNode {
 public:
  explicit DetectorNode(Executor& executor) : executor_(executor), topic_(executor) {}

  // The subscription's callback.
  void on_image(Timestamp t) {
    if (!operator_.open(t, 90ms)) return;
    infer(t, fuseline::local, 60ms, "on board");
    for (const auto& [cloud, takes] : {std::pair(near, 35ms), std::pair(far, t.count % 3 == 2 ? 500ms : 45ms)}) {
      if (operator_.offer(t, cloud, 80ms, 0)) infer(t, cloud, takes, cloud == near ? "near" : "far");
    }
    arm();
  }

  const Topic& boxes() const { return topic_; }
  std::size_t held() const { return operator_.held(); }

 private:
  static constexpr Priority near{1}, far{2};

  void infer(Timestamp t, Priority source, Executor::Clock::duration takes, const char* by) {
    executor_.call_after(takes, [this, t, source, by] {
      operator_.result(t, source, Message(new Boxes{by}));
      arm();
    });
  }

  // A wall timer for the next due instant. One that is too early or no longer wanted ticks to no effect (P10).
  void arm() {
    const auto due = operator_.next_due();
    if (!due || (armed_ && *armed_ == *due)) return;
    armed_ = due;
    executor_.call_at(*due, [this] {
      armed_.reset();
      operator_.tick();
      arm();
    });
  }

  Executor& executor_;
  Topic topic_;
  std::optional<Executor::Clock::time_point> armed_;
  fuseline::Operator<Message, Topic, fuseline::C3W16, Executor::Clock> operator_{
      topic_, 8, fuseline::Commit::eager, 200ms, {{near, 31}, {far, 31}}, executor_.clock};
};

int main() {
  Executor executor;
  DetectorNode node(executor);
  for (std::uint64_t i = 0; i < 9; ++i) executor.call_after(33ms * i, [&node, i] { node.on_image(Timestamp{i}); });
  executor.spin();
  std::printf("%u of 9 published, %u calls cancelled, %zu values left\n", node.boxes().published, node.boxes().cancelled,
              node.held());
  return node.boxes().published == 9 && node.held() == 0 ? 0 : 1;
}
