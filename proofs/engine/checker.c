// The checker's side of the stand-in: its imports, traps, and the run of one harness.
//
// One question asks all: whether every assertion holds, and what is reached. Each cover, and the end of the harness, is a
// property that must fail.

#include GENERATED

struct w2c_kani { int unused; };

u64 w2c_kani_any_bits(struct w2c_kani* kani, u32 bits) {
  u64 value;
  (void)kani;
  if (bits < 64) __CPROVER_assume(value >> bits == 0);
  __CPROVER_input("any", value);
  return value;
}

void w2c_kani_assume(struct w2c_kani* kani, u32 condition) {
  (void)kani;
  __CPROVER_assume(condition & 1);
}

// What is asserted about the machine.
void w2c_kani_check(struct w2c_kani* kani, u32 condition, u32 file, u32 len, u32 line, u32 text, u32 text_len) {
  (void)kani;
  if (!(condition & 1)) {
    __CPROVER_input("file", file), __CPROVER_input("file_len", len), __CPROVER_input("line", line);
    __CPROVER_input("text", text), __CPROVER_input("text_len", text_len);
    __CPROVER_assert(0, "assertion");
    __CPROVER_assume(0);
  }
}

// Overflows, debug assertions and whatever else panics.
void w2c_kani_fail(struct w2c_kani* kani, u32 file, u32 len, u32 line) {
  (void)kani;
  __CPROVER_input("file", file), __CPROVER_input("file_len", len), __CPROVER_input("line", line);
  __CPROVER_assert(0, "panic");
  __CPROVER_assume(0);
}

void wasm_rt_trap(wasm_rt_trap_t trap) {
  __CPROVER_assert(0, "trap");
  __CPROVER_assume(0);
}

void w2c_kani_cover(struct w2c_kani* kani, u32 condition, u32 line) {
  (void)kani;
#define COVER(at) if (line == at) __CPROVER_assert(!(condition & 1), "cover " #at);
  COVERS
}

int main(void) {
  w2c_proofs instance;
  struct w2c_kani kani;
  instance.w2c_kani_instance = &kani;
  init_globals(&instance);
  w2c_proofs_harness(&instance);
  __CPROVER_assert(0, "end");
  return 0;
}
