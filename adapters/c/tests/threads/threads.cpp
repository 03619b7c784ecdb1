// Several threads at one machine for many threads, through the C interface: writes what they saw as an observed trace.
//
//     threads [eager|patient|progressive] [MESSAGES] >trace.jsonl
//     fuseline check --observed --tolerance 0ms --lateness 0ms trace.jsonl
//
// The clock is virtual: each instant is a round between two barriers, in which the owner opens and offers, each source gives
// results and failures, and a timer lets time go by and reports failures that the sources know nothing of, all at once. So
// instants are exact, nothing is late, and the judge needs no tolerance, however busy the machine is. A source stores
// its value beside the machine, without a lock, before it gives its result; who is to forward it, or that it was the
// last, reads it: so the thread sanitizer sees whether the machine orders the two.
#include <atomic>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "fuseline.h"

namespace {

constexpr unsigned kSources = 4, kWindow = 64, kOpens = 16;
constexpr std::uint64_t kLife = 12;         // rounds after which a message is decided, whatever happened
constexpr std::uint64_t kRoom = 256;        // more than are opened in so many rounds
constexpr std::uint64_t kLongest = 6;       // a request's deadline, in rounds
static_assert(kRoom >= kOpens * (kLife + 2), "a message's place is used again only after its life");

struct Message {
  std::uint64_t opened = 0;
  bool is_open = false;
  fuseline_message_id message_id{};
  std::atomic<bool> is_asked[kSources];
  // Each its source's alone.
  bool has_answered[kSources];
  std::uint64_t stored_at[kSources];
  std::uint64_t values[kSources];
};

struct Line {
  std::uint64_t at;
  std::string text;
};

// The values that the barrier changes, while all threads wait.
std::uint64_t now = 0, visible = 0;
// The owner's.
std::uint64_t newest = 0;
std::uint64_t messages = 10000;
Message table[kRoom];
std::uint32_t commit = FUSELINE_COMMIT_EAGER;
fuseline_shared* machine = nullptr;
std::atomic<unsigned> failures{0}, met{0};

std::uint64_t value_of(std::uint64_t t, std::uint64_t p) { return t * 31 + p * 7 + 1; }

// Steele and Vigna's SplitMix64, of what a thread is about to decide.
std::uint64_t chance(std::uint64_t who, std::uint64_t t, std::uint64_t what) {
  std::uint64_t z = (who * 0x10001 + t) * 0x9e3779b97f4a7c15U + now * 0x2545f4914f6cdd1dU + what;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
  return z ^ (z >> 31);
}

class Barrier {
 public:
  explicit Barrier(unsigned threads) : threads_(threads) {}
  void wait() {
    std::unique_lock<std::mutex> lock(mutex_);
    const std::uint64_t round = now;
    if (++arrived_ < threads_) {
      turned_.wait(lock, [&] { return now != round; });
      return;
    }
    arrived_ = 0;
    ++now;
    visible = newest;
    turned_.notify_all();
  }

 private:
  const unsigned threads_;
  unsigned arrived_ = 0;
  std::mutex mutex_;
  std::condition_variable turned_;
};

// One thread, and what it saw.
class Caller {
 public:
  explicit Caller(std::uint64_t who) : who_(who) {}
  std::vector<Line> lines;

  void open(std::uint64_t t) {
    Message& message = table[t % kRoom];
    fuseline_answer answer;
    const std::uint64_t deadline = chance(who_, t, 1) % 3 == 0 ? 0 : 1 + chance(who_, t, 2) % (kLife - 2);
    const fuseline_status status =
        deadline > 0 ? fuseline_shared_open_within(machine, now, t, deadline, &message.message_id, &answer)
                     : fuseline_shared_open(machine, now, t, &message.message_id, &answer);
    done(status);
    message.opened = now;
    message.is_open = answer.outcome == FUSELINE_OUTCOME_ACCEPTED;
    for (unsigned p = 0; p < kSources; ++p) {
      message.is_asked[p].store(p == 0, std::memory_order_relaxed);
      message.has_answered[p] = false;
    }
    if (message.is_open) fact("open", t, "", 0, "deadline", deadline);
  }

  void offer(Message& message, std::uint64_t t, unsigned p) {
    fuseline_answer fired, answer;
    const std::uint64_t deadline = 1 + chance(who_, t, p) % kLongest;
    done(fuseline_shared_offer(machine, now, message.message_id, p, deadline, 0, &fired, &answer));
    if (answer.outcome == FUSELINE_OUTCOME_ADMITTED) {
      fact("request", t, "p", p, "due", answer.due);
      message.is_asked[p].store(true, std::memory_order_release);
    }
    heard(message, fired);
  }

  void result(Message& message, std::uint64_t t, unsigned p) {
    fuseline_answer fired, answer;
    if (!message.has_answered[p]) {
      message.has_answered[p] = true;
      message.stored_at[p] = now;
      message.values[p] = value_of(t, p);
    }
    fact("result", t, "p", p);
    done(fuseline_shared_result(machine, now, message.message_id, p, &fired, &answer));
    heard(message, fired);
    heard(message, answer);
  }

  void fail(Message& message, std::uint64_t t, unsigned p) {
    fuseline_answer fired, answer;
    fact("fail", t, "p", p);
    done(fuseline_shared_fail(machine, now, message.message_id, p, &fired, &answer));
    heard(message, fired);
    heard(message, answer);
  }

  void expire(Message& message) {
    fuseline_answer fired, answer;
    done(fuseline_shared_expire(machine, now, message.message_id, &fired, &answer));
    heard(message, fired);
  }

 private:
  void heard(const Message& message, const fuseline_answer& answer) {
    if (answer.outcome == FUSELINE_OUTCOME_MISSED) fact("miss", answer.t);
    const bool is_last = answer.outcome == FUSELINE_OUTCOME_FORWARDED, is_final = answer.outcome == FUSELINE_OUTCOME_FINAL;
    if (!is_last && !is_final && answer.outcome != FUSELINE_OUTCOME_PRELIMINARY) return;
    if (!is_final) fact("emit", answer.t, "p", answer.by);
    if (is_final || (is_last && commit == FUSELINE_COMMIT_PROGRESSIVE)) fact("final", answer.t, "p", answer.by);
    if (message.values[answer.by] != value_of(answer.t, answer.by)) ++failures;
    // Another thread's value, of this very round: nothing but the machine orders the two.
    if (message.stored_at[answer.by] == now && answer.by != who_) ++met;
  }

  void fact(const char* ev, std::uint64_t t, const char* key = "", std::uint64_t of = 0, const char* more = "",
            std::uint64_t of_more = 0) {
    std::string text = std::string("{\"ev\":\"") + ev + "\",\"at\":" + std::to_string(now) + ",\"t\":" + std::to_string(t);
    if (*key != '\0') text += std::string(",\"") + key + "\":" + std::to_string(of);
    if (of_more > 0) text += std::string(",\"") + more + "\":" + std::to_string(of_more);
    lines.push_back({now, text + "}\n"});
  }

  static void done(fuseline_status status) {
    if (status != FUSELINE_STATUS_DONE) ++failures;
  }

  std::uint64_t who_;
};

bool is_over() { return visible >= messages && now > table[messages % kRoom].opened + kLife; }

// Each message that others may call for, the youngest first or the oldest.
template <class Visit>
void each_message(std::uint64_t who, Visit visit) {
  // Not those whose places the owner may be using again in this round.
  const std::uint64_t most = kRoom - kOpens, len = visible < most ? visible : most;
  const bool is_up = chance(who, 0, 0) % 2 == 0;
  for (std::uint64_t i = 0; i < len; ++i) {
    const std::uint64_t t = is_up ? visible - len + 1 + i : visible - i;
    Message& message = table[t % kRoom];
    if (message.is_open && message.opened + kLife >= now) visit(message, t);
  }
}

void owner(Caller& caller) {
  each_message(kSources, [&](Message& message, std::uint64_t t) {
    if (message.opened + 2 < now) return;
    for (unsigned p = 1; p < kSources; ++p) {
      if (chance(kSources, t, p + 8) % 2 == 0) caller.offer(message, t, p);
    }
  });
  for (unsigned i = 0; i < kOpens && newest < messages; ++i) caller.open(++newest);
}

void source(Caller& caller, unsigned p) {
  each_message(p, [&](Message& message, std::uint64_t t) {
    const std::uint64_t dice = chance(p, t, 3) % 16;
    const bool is_last = p == 0 && message.opened + kLife == now + 2 && !message.has_answered[p];
    if (!message.is_asked[p].load(std::memory_order_acquire)) return;
    if (dice < 3 || is_last) return caller.result(message, t, p);
    if (dice == 3) caller.fail(message, t, p);
  });
}

void timer(Caller& caller) {
  each_message(kSources + 1, [&](Message& message, std::uint64_t t) {
    const unsigned p = static_cast<unsigned>(chance(kSources + 1, t, 4) % (kSources * 4));
    if (p < kSources && message.is_asked[p].load(std::memory_order_acquire)) caller.fail(message, t, p);
    caller.expire(message);
  });
}

alignas(64) unsigned char storage[16384];

}  // namespace

int main(int argc, char** argv) {
  const char* const rules[] = {"eager", "patient", "progressive"};
  while (argc > 1 && std::strcmp(argv[1], rules[commit]) != 0) {
    if (++commit == 3) return 2;
  }
  if (argc > 2) messages = std::strtoull(argv[2], nullptr, 10);
  const fuseline_cloud clouds[] = {{1, 31, 30}, {2, 31, 30}, {3, 31, 30}};
  const fuseline_config config = {FUSELINE_CONFIG, FUSELINE_CAPACITY_C7W64, commit, kWindow, kSources - 1, clouds, UINT64_MAX};
  if (fuseline_shared_init(storage, sizeof storage, &config, &machine) != FUSELINE_STATUS_DONE) return 2;

  std::vector<Caller> callers;
  for (unsigned who = 0; who < kSources + 2; ++who) callers.emplace_back(who);
  Barrier barrier(kSources + 2);
  std::vector<std::thread> threads;
  for (unsigned who = 0; who < kSources + 2; ++who) {
    threads.emplace_back([&, who] {
      Caller& caller = callers[who];
      while (!is_over()) {
        if (who < kSources) source(caller, who);
        if (who == kSources) owner(caller);
        if (who == kSources + 1) timer(caller);
        barrier.wait();
      }
    });
  }
  for (std::thread& thread : threads) thread.join();

  std::printf("{\"fuseline\":1,\"operator\":\"threads over C\",\"window\":%u,\"commit\":\"%s\",\"clouds\":"
              "[{\"p\":1,\"limit\":31},{\"p\":2,\"limit\":31},{\"p\":3,\"limit\":31}]}\n",
              kWindow, rules[commit]);
  std::vector<std::size_t> next(callers.size(), 0);
  for (std::uint64_t at = 0; at <= now; ++at) {
    for (std::size_t who = 0; who < callers.size(); ++who) {
      const std::vector<Line>& lines = callers[who].lines;
      for (std::size_t& i = next[who]; i < lines.size() && lines[i].at == at; ++i) std::fputs(lines[i].text.c_str(), stdout);
    }
  }
  std::fprintf(stderr, "%llu rounds; %u values of another thread's sent or final in the round they were stored in; %u wrong\n",
               static_cast<unsigned long long>(now), met.load(), failures.load());
  if (fuseline_shared_end(machine) != FUSELINE_STATUS_DONE) return 2;
  return failures == 0 && met > 0 ? 0 : 1;
}
