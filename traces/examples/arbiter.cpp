// A fusion operator's decisions in plain C++17: a template for an implementation of your own.
//
// It answers what `fuseline drive` asks. From the repository:
//
//     g++ -std=c++17 -O2 -o arbiter traces/examples/arbiter.cpp && fuseline drive -- ./arbiter
//
// The rules are those of SPEC.md; each function names its own. Nothing here waits or reads a clock.

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

using u64 = std::uint64_t;

constexpr u64 LOCAL = 0;  // the priority of the computation on board, which every message gets
constexpr u64 END = std::numeric_limits<u64>::max();  // instants do not wrap
using Why = const char*;  // why something is refused or dropped; null if it is not

// The little of JSON that the trace's lines need: numbers, words, lists and objects.
struct Json {
  u64 number = 0;
  std::string text;
  std::vector<Json> items;
  std::map<std::string, Json> members;
  bool has(const std::string& key) const { return members.count(key) > 0; }
  u64 at(const std::string& key) const { return members.at(key).number; }

  static Json parse(const char*& s) {
    Json json;
    space(s);
    if (*s == '{') {
      each(s, '}', [&] {
        std::string key = parse(s).text;
        expect(s, ':');
        json.members[key] = parse(s);
      });
    } else if (*s == '[') {
      each(s, ']', [&] { json.items.push_back(parse(s)); });
    } else if (*s == '"') {
      for (++s; *s && *s != '"'; ++s) {
        if (*s == '\\') ++s;
        json.text += *s;
      }
      expect(s, '"');
    } else if (std::isdigit(static_cast<unsigned char>(*s))) {
      while (std::isdigit(static_cast<unsigned char>(*s))) json.number = json.number * 10 + (*s++ - '0');
    } else {
      throw std::runtime_error("a line that is no JSON of the trace");
    }
    return json;
  }

 private:
  static void space(const char*& s) { s += std::strspn(s, " "); }
  static void expect(const char*& s, char wanted) {
    space(s);
    if (*s++ != wanted) throw std::runtime_error(std::string("expected ") + wanted);
  }
  template <typename F>
  static void each(const char*& s, char end, F item) {
    for (++s, space(s); *s != end; space(s)) {
      item();
      space(s);
      if (*s != end) expect(s, ',');
    }
    ++s;
  }
};

// Admission of one cloud's requests by the length of its queue (F2g).
struct Gate {
  u64 limit, resume;
  bool is_open = true;
  bool admits(u64 backlog) { return is_open = is_open ? backlog < limit : backlog <= resume; }
};

// The four sets of one open timestamp.
struct Message {
  std::set<u64> requested{LOCAL};  // was asked for
  std::set<u64> pending{LOCAL};    // asked for; neither result nor failure nor timer has come
  std::map<u64, u64> armed;        // whose timer is live, with its due instant
  std::set<u64> cached;            // whose result came in time and is held; progressive: was sent last
};

class Arbiter {
 public:
  explicit Arbiter(const Json& header) : window(header.at("window")) {
    eager = !header.has("commit") || header.members.at("commit").text == "eager";
    progressive = header.has("commit") && header.members.at("commit").text == "progressive";
    for (const Json& cloud : header.members.at("clouds").items) {
      u64 limit = cloud.at("limit");
      gates[cloud.at("p")] = Gate{limit, cloud.has("resume") ? cloud.at("resume") : limit - 1};
    }
  }

  // Applies one input and says its decisions, in order.
  void apply(const Json& event) {
    // F0: time does not go back, and whatever is due comes before the input.
    now = std::max(now, event.at("at"));
    expire();
    const std::string& ev = event.members.at("ev").text;
    if (ev == "tick") return;
    u64 t = event.at("t");
    if (ev == "open") return opened(t, event.has("deadline"), event.has("deadline") ? event.at("deadline") : 0);
    u64 p = event.at("p");
    if (ev == "offer") return offered(t, p, event.at("deadline"), event.at("backlog"));
    if (Why why = drops(t, p)) return say("drop", t, &p, why);
    Message& message = open[t];
    message.pending.erase(p);
    if (ev == "result") return result(t, message, p);
    // F4: no result will come. This is no timer: it commits nothing by itself.
    disarm(t, message, p);
    settle(t, message, false);
  }

 private:
  u64 window, now = 0, newest = 0;
  bool eager, progressive, any = false;  // any: whether a timestamp was ever opened, the newest of which is `newest`
  std::map<u64, Gate> gates;
  std::map<u64, Message> open;
  std::set<std::tuple<u64, u64, u64>> timers;  // every live timer: due instant, timestamp, priority

  // F1: a message came. A deadline is how long local may take.
  void opened(u64 t, bool limited, u64 deadline) {
    u64 due = after(deadline);
    Why why = reached(t) ? "order" : open.size() >= window ? "full" : limited && due <= now ? "deadline" : nullptr;
    if (why) return say("refuse", t, nullptr, why);
    newest = t;
    any = true;
    open[t];
    if (limited) arm(t, LOCAL, due);
  }

  // F2: the driver would ask cloud p, whose queue holds this many requests already.
  void offered(u64 t, u64 p, u64 deadline, u64 backlog) {
    u64 due = after(deadline);
    if (Why why = refuses(t, p, due, backlog)) return say("refuse", t, &p, why);
    open[t].requested.insert(p);
    open[t].pending.insert(p);
    arm(t, p, due);
    say("request", t, &p, nullptr, &due);
  }

  // F2: the first reason that holds. The gate is asked last, and only if nothing else refuses.
  Why refuses(u64 t, u64 p, u64 due, u64 backlog) {
    if (!gates.count(p) || !reached(t)) return "unknown";
    if (!open.count(t)) return "closed";
    const Message& message = open[t];
    if (message.requested.count(p)) return "duplicate";
    if (outranked(p, message.cached)) return "outranked";
    if (due <= now) return "deadline";
    return gates[p].admits(backlog) ? nullptr : "queue";
  }

  // F3, F4: the first reason that holds.
  Why drops(u64 t, u64 p) {
    if ((p != LOCAL && !gates.count(p)) || !reached(t)) return "unknown";
    if (!open.count(t)) return "superseded";
    const Message& message = open[t];
    if (progressive && outranked(p, message.cached)) return "superseded";
    if (!message.requested.count(p)) return "unsolicited";
    if (message.cached.count(p)) return "duplicate";
    return message.pending.count(p) ? nullptr : "late";
  }

  // F3: a source returned. A held cloud's timer runs on under eager.
  void result(u64 t, Message& message, u64 p) {
    if (progressive) return send(t, message, p);
    if (!outranked(p, message.pending)) return forward(t, message, p);
    message.cached.insert(p);
    if (p == LOCAL || !eager) disarm(t, message, p);
    say("hold", t, &p);
  }

  // F5: serves what is due, by due instant, then timestamp; equal ones of one timestamp together.
  void expire() {
    while (!timers.empty() && std::get<0>(*timers.begin()) <= now) {
      auto [due, t, first] = *timers.begin();
      Message& message = open[t];
      bool cloud = false;
      for (u64 p = first;; p = std::get<2>(*timers.begin())) {
        disarm(t, message, p);
        message.pending.erase(p);
        cloud |= p != LOCAL;
        say("timer", t, &p);
        if (timers.empty() || std::get<0>(*timers.begin()) != due || std::get<1>(*timers.begin()) != t) break;
      }
      settle(t, message, cloud);  // local's timer alone commits nothing
    }
  }

  // F6: some requests were closed; commit, miss or wait. Progressive ends or waits (F9).
  void settle(u64 t, Message& message, bool by_timer) {
    if (!message.cached.empty()) {
      u64 best = *message.cached.rbegin();
      if (!outranked(best, message.pending) || (eager && by_timer)) progressive ? end(t, best) : forward(t, message, best);
    } else if (message.pending.empty()) {
      open.erase(t);
      say("miss", t);
    }
  }

  // F7: one result goes, the timestamp is over, and so are the calls of clouds; never local's.
  void forward(u64 t, Message& message, u64 p) {
    say("emit", t, &p);
    for (u64 cloud : message.pending)
      if (cloud != LOCAL) say("cancel", t, &cloud);
    while (!message.armed.empty()) disarm(t, message, message.armed.begin()->first);
    open.erase(t);
  }

  // F9: one result goes at once, and what it outranks is not waited for any more.
  void send(u64 t, Message& message, u64 p) {
    message.cached = {p};
    say("emit", t, &p);
    disarm(t, message, p);
    while (!message.pending.empty() && *message.pending.begin() < p) {
      u64 worse = *message.pending.begin();
      message.pending.erase(worse);
      disarm(t, message, worse);
      if (worse != LOCAL) say("cancel", t, &worse);
    }
    if (message.pending.empty()) end(t, p);
  }

  // F9: nothing better can come than what was sent.
  void end(u64 t, u64 p) {
    open.erase(t);
    say("final", t, &p);
  }

  void arm(u64 t, u64 p, u64 due) { timers.insert({open[t].armed[p] = due, t, p}); }
  void disarm(u64 t, Message& message, u64 p) {
    auto timer = message.armed.find(p);
    if (timer == message.armed.end()) return;
    timers.erase({timer->second, t, p});
    message.armed.erase(timer);
  }
  static bool outranked(u64 p, const std::set<u64>& others) { return !others.empty() && *others.rbegin() > p; }
  bool reached(u64 t) const { return any && t <= newest; }
  u64 after(u64 span) const { return span > END - now ? END : now + span; }

  void say(const char* ev, u64 t, const u64* p = nullptr, Why why = nullptr, const u64* due = nullptr) const {
    std::cout << "{\"ev\":\"" << ev << "\",\"at\":" << now << ",\"t\":" << t;
    if (p) std::cout << ",\"p\":" << *p;
    if (due) std::cout << ",\"due\":" << *due;
    if (why) std::cout << ",\"why\":\"" << why << '"';
    std::cout << "}\n";
  }
};

// Answers each line: a header starts afresh, an input is decided about, then `done`.
int main() {
  std::unique_ptr<Arbiter> arbiter;
  for (std::string line; std::getline(std::cin, line);) {
    const char* text = line.c_str();
    Json event = Json::parse(text);
    if (event.has("fuseline")) arbiter = std::make_unique<Arbiter>(event);
    else arbiter->apply(event);
    std::cout << "{\"ev\":\"done\"}\n" << std::flush;  // whoever asks waits for the whole answer
  }
}
