// Linear memory for the checker, in place of wasm2c's byte array: the stack as one small array of 64-bit words, the data
// segment, which is never written, as constant bytes. Addresses are constants almost everywhere, so that the shifts and
// the second words fold away. Where one is not, each word counts: so there are no more than the frames take. Anything
// beyond both is a trap.
//
// STACK_LOW, below which no frame lies, STACK_BYTES, DATA_BYTES and the bytes DATA_INIT are defined by the runner.

u64 STACK[(STACK_BYTES - STACK_LOW) / 8 + 1];
static const unsigned char DATA[DATA_BYTES + 8] = DATA_INIT;

#define WORD(at) (((at) - STACK_LOW) >> 3)

static inline void check_store(u64 at, u32 len) {
  if (at < STACK_LOW || at + len > STACK_BYTES) wasm_rt_trap(WASM_RT_TRAP_OOB);
}

static inline void check_load(u64 at, u32 len) {
  if (!((at >= STACK_LOW && at + len <= STACK_BYTES) || (at >= STACK_BYTES && at + len <= STACK_BYTES + DATA_BYTES)))
    wasm_rt_trap(WASM_RT_TRAP_OOB);
}

static inline u64 stack_bytes(u64 at, u32 len) {
  u64 word = WORD(at), shift = (at & 7) * 8, value;
  if (shift == 0) value = STACK[word];
  else value = STACK[word] >> shift;
  if (shift + 8 * len > 64) value |= STACK[word + 1] << (64 - shift);
  return value;
}

static inline void put_stack(u64 at, u32 len, u64 value) {
  u64 word = WORD(at), shift = (at & 7) * 8;
  u64 mask = len == 8 ? ~0ull : (1ull << (8 * len)) - 1;
  value &= mask;
  if (shift == 0 && len == 8) STACK[word] = value;
  else STACK[word] = (STACK[word] & ~(mask << shift)) | (value << shift);
  if (shift + 8 * len > 64)
    STACK[word + 1] = (STACK[word + 1] & ~(mask >> (64 - shift))) | (value >> (64 - shift));
}

static inline u64 data_bytes(u64 at, u32 len) {
  u64 value = 0;
  if (len > 0) value |= (u64)DATA[at];
  if (len > 1) value |= (u64)DATA[at + 1] << 8;
  if (len > 2) value |= (u64)DATA[at + 2] << 16 | (u64)DATA[at + 3] << 24;
  if (len > 4)
    value |= (u64)DATA[at + 4] << 32 | (u64)DATA[at + 5] << 40 | (u64)DATA[at + 6] << 48 | (u64)DATA[at + 7] << 56;
  return value;
}

#define LOAD(name, len, narrow, sign, wide)                                \
  static inline wide name(wasm_rt_memory_t* memory, u64 at) {              \
    u64 value;                                                             \
    (void)memory;                                                          \
    check_load(at, len);                                                   \
    if (at < STACK_BYTES) value = stack_bytes(at, len);                     \
    else value = data_bytes(at - STACK_BYTES, len);                         \
    return (wide)(sign)(narrow)value;                                      \
  }
#define STORE(name, len, wide)                                             \
  static inline void name(wasm_rt_memory_t* memory, u64 at, wide value) {  \
    (void)memory;                                                          \
    check_store(at, len);                                                  \
    put_stack(at, len, (u64)value);                                      \
  }
LOAD(i32_load, 4, u32, u32, u32)
LOAD(i64_load, 8, u64, u64, u64)
LOAD(i32_load8_s, 1, s8, s32, u32)
LOAD(i64_load8_s, 1, s8, s64, u64)
LOAD(i32_load8_u, 1, u8, u32, u32)
LOAD(i64_load8_u, 1, u8, u64, u64)
LOAD(i32_load16_s, 2, s16, s32, u32)
LOAD(i64_load16_s, 2, s16, s64, u64)
LOAD(i32_load16_u, 2, u16, u32, u32)
LOAD(i64_load16_u, 2, u16, u64, u64)
LOAD(i64_load32_s, 4, s32, s64, u64)
LOAD(i64_load32_u, 4, u32, u64, u64)
STORE(i32_store, 4, u32)
STORE(i64_store, 8, u64)
STORE(i32_store8, 1, u32)
STORE(i32_store16, 2, u32)
STORE(i64_store8, 1, u64)
STORE(i64_store16, 2, u64)
STORE(i64_store32, 4, u64)

static inline void memory_fill(wasm_rt_memory_t* memory, u32 at, u32 byte, u32 len) {
  u32 i = 0;
  (void)memory;
  check_store(at, len);
  byte &= 255;
  if ((at & 7) == 0)
    for (; i + 8 <= len; i += 8) STACK[WORD(at + i)] = byte * 0x0101010101010101ull;
  for (; i < len; i++) put_stack(at + i, 1, byte);
}

// Word by word where both ends allow it; from above where the ends overlap.
static inline void memory_copy(wasm_rt_memory_t* memory, const wasm_rt_memory_t* same, u32 to, u32 from, u32 len) {
  u32 i = 0, aligned = ((to | from) & 7) == 0;
  (void)memory, (void)same;
  check_store(to, len);
  check_load(from, len);
  if (len == 0 || to == from) return;
  if (from >= STACK_BYTES) {
    for (; i < len; i++) put_stack(to + i, 1, DATA[from - STACK_BYTES + i]);
  } else if (to < from) {
    if (aligned)
      for (; i + 8 <= len; i += 8) STACK[WORD(to + i)] = STACK[WORD(from + i)];
    for (; i < len; i++) put_stack(to + i, 1, stack_bytes(from + i, 1));
  } else {
    i = len;
    if (aligned) {
      for (; i & 7; i--) put_stack(to + i - 1, 1, stack_bytes(from + i - 1, 1));
      for (; i > 0; i -= 8) STACK[WORD(to + i - 8)] = STACK[WORD(from + i - 8)];
    }
    for (; i > 0; i--) put_stack(to + i - 1, 1, stack_bytes(from + i - 1, 1));
  }
}
