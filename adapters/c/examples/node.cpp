// A perception node with plain threads, as in a C++ driving stack: a camera, a detector on board, a better one in the
// cloud behind a network that fails for a while. One thread owns the operator; the others post to it.
#include <condition_variable>
#include <cstdio>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "fuseline.hpp"

using namespace std::chrono_literals;
using fuseline::Priority;
using fuseline::Timestamp;
using Clock = std::chrono::steady_clock;

constexpr Priority cloud{1};
constexpr unsigned messages = 20;

// The tasks of the operator's thread, in the order in which they came.
class Inbox {
 public:
  void post(std::function<void()> task) {
    const std::lock_guard<std::mutex> lock(mutex_);
    tasks_.push_back(std::move(task));
    came_.notify_one();
  }
  // The next task, or none at the due instant.
  std::function<void()> take(const std::optional<Clock::time_point>& due) {
    std::unique_lock<std::mutex> lock(mutex_);
    const auto any = [this] { return !tasks_.empty(); };
    if (!due) came_.wait(lock, any);
    else if (!came_.wait_until(lock, *due, any)) return nullptr;
    auto task = std::move(tasks_.front());
    tasks_.pop_front();
    return task;
  }

 private:
  std::mutex mutex_;
  std::condition_variable came_;
  std::deque<std::function<void()>> tasks_;
};

// Receives the outputs that go downstream.
struct Planner : fuseline::Sink<std::string> {
  unsigned local = 0, better = 0, missed = 0;
  void forward(Timestamp t, Priority by, std::string boxes) {
    ++(by == cloud ? better : local);
    std::printf("message %2llu: %s\n", static_cast<unsigned long long>(t.count), boxes.c_str());
  }
  void miss(Timestamp t) {
    ++missed;
    std::printf("message %2llu: missed\n", static_cast<unsigned long long>(t.count));
  }
  unsigned sum() const { return local + better + missed; }
};

class Node {
 public:
  bool run() {
    if (!operator_) {
      std::fprintf(stderr, "no operator: %s\n", fuseline_status_name(operator_.status()));
      return false;
    }
    workers_.emplace_back([this] {  // the camera: 100 messages a second
      for (std::uint64_t i = 0; i < messages; ++i) {
        inbox_.post([this, i] { message(Timestamp{i}); });
        std::this_thread::sleep_for(10ms);
      }
    });
    while (planner_.sum() + refused_ < messages) {
      const auto task = inbox_.take(operator_.next_due());
      if (task) task();
      else if (!operator_.tick()) return false;
    }
    for (std::thread& worker : workers_) worker.join();
    std::printf("%u messages: %u by the cloud, %u by local, %u missed, %u refused, %zu values left\n", messages,
                planner_.better, planner_.local, planner_.missed, refused_, operator_.held());
    return operator_.held() == 0;
  }

 private:
  void message(Timestamp t) {
    if (!operator_.open(t)) {
      ++refused_;
      return;
    }
    compute(t, fuseline::local, 15ms, "boxes of the detector on board");
    // From the 8th to the 13th message the network loses whatever is sent.
    if (operator_.offer(t, cloud, 40ms, 0) && (t.count < 8 || t.count > 13)) {
      compute(t, cloud, 25ms, "better boxes of the cloud");
    }
  }

  // Stands for a model, on board or behind a call.
  void compute(Timestamp t, Priority source, Clock::duration takes, const char* boxes) {
    workers_.emplace_back([this, t, source, takes, boxes] {
      std::this_thread::sleep_for(takes);
      inbox_.post([this, t, source, boxes] { operator_.result(t, source, boxes); });
    });
  }

  Planner planner_;
  Inbox inbox_;
  unsigned refused_ = 0;
  std::vector<std::thread> workers_;
  fuseline::Operator<std::string, Planner> operator_{planner_, 16, fuseline::Commit::eager, 1s, {{cloud, 31}}};
};

int main() { return Node().run() ? 0 : 1; }
