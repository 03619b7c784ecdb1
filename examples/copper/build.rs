//! Tells Copper's macros where the strings of its log are.

fn main() {
    cu29_build::setup();
}
