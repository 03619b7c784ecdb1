use byteorder::{BigEndian, LittleEndian};
use cdr_encoding::to_vec;
use proptest::prelude::*;
use serde::Serialize;

use super::cdr::CdrError;
use super::ros_msg::layout;

const DETECTION: &str = "\
# What a detector says.
uint8 NONE=0
string<=8 KIND = \"a # b\"
std_msgs/Header header   # of the image
bool is_final
int16 delta -3
Box[] boxes
float64[2] centre
uint8[<=9] mask
string[] words
Nothing nothing
float32 score
uint64 frame
builtin_interfaces/Duration budget
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===============================================================================
MSG: robot_msgs/Box
string label
float64 size
================================================================================
MSG: robot_msgs/Nothing
# nothing
";

#[derive(Serialize)]
struct WireTime(i32, u32);

#[derive(Serialize)]
struct WireDetection {
    header: (WireTime, &'static str),
    is_final: bool,
    delta: i16,
    boxes: Vec<(&'static str, f64)>,
    centre: [f64; 2],
    mask: Vec<u8>,
    words: Vec<&'static str>,
    nothing: u8,
    score: f32,
    frame: u64,
    budget: WireTime,
}

fn detection() -> WireDetection {
    WireDetection {
        header: (WireTime(1_795_629_600, 5), "front"),
        is_final: true,
        delta: -2,
        boxes: vec![("car", 1.0), ("dog", 2.0)],
        centre: [0.0; 2],
        mask: vec![1, 2, 3],
        words: vec!["a", "bcd"],
        nothing: 0,
        score: 0.1,
        frame: u64::MAX,
        budget: WireTime(-1, 500_000_000),
    }
}

#[test]
fn what_another_library_encodes_is_read_by_the_definition() {
    let layout = layout("robot_msgs/msg/Detection", DETECTION).unwrap();
    let little = to_vec::<_, LittleEndian>(&detection()).unwrap();
    let big = to_vec::<_, BigEndian>(&detection()).unwrap();
    let expected = [
        ("header.stamp.sec", "1795629600"),
        ("header.stamp.nanosec", "5"),
        ("header.stamp", "1795629600.000000005s"),
        ("header.frame_id", "front"),
        ("is_final", "true"),
        ("delta", "-2"),
        ("score", "0.1"),
        ("frame", "18446744073709551615"),
        ("budget.sec", "-1"),
        ("budget.nanosec", "500000000"),
        ("budget", "-0.500000000s"),
    ];
    let expected = expected.map(|(path, text)| (path.into(), text.to_owned()));
    for (kind, body) in [([0, 1, 0, 0], little), ([0, 0, 0, 0], big)] {
        let message = [&kind[..], &body].concat();
        assert_eq!(layout.read(&message).unwrap(), expected);
        for len in 0..message.len() {
            assert!(matches!(layout.read(&message[..len]), Err(CdrError::Short(_))), "{len}");
        }
    }
    assert_eq!(layout.read(&[0, 7, 0, 0, 1]).unwrap_err(), CdrError::Encapsulation(7));
}

#[test]
fn a_type_that_has_no_end_is_refused() {
    let itself = layout("a/A", "a/A[2] inner\n").unwrap();
    assert_eq!(itself.read(&[0, 1, 0, 0, 1]).unwrap_err(), CdrError::Nested);
    let twice = |n: u32| format!("===========\nMSG: a/Twice{n}\nTwice{0} a\nTwice{0} b\n", n - 1);
    let types: String = (1..31).rev().map(twice).collect();
    let text = format!("Twice30 a\n{types}==========\nMSG: a/Twice0\nuint8[0] none\n");
    let wide = layout("a/Wide", &text).unwrap();
    assert_eq!(wide.read(&[0, 1, 0, 0]).unwrap_err(), CdrError::Nested);
    // A sequence of 2³² values without bytes ends.
    let empty = layout("a/A", "B[] b\n=========\nMSG: a/B\nuint8[0] none\n").unwrap();
    assert!(empty.read(&[0, 1, 0, 0, 255, 255, 255, 255]).unwrap().is_empty());
}

#[test]
fn a_definition_that_is_not_understood_is_refused() {
    for (text, expected) in [
        ("wstring name\n", "of type \"wstring\", which the schema does not define"),
        ("other_msgs/Thing thing\n", "of type \"other_msgs/Thing\""),
        ("int32\n", "a line \"int32\", which is not a field"),
        ("int32[x] y\n", "a line \"int32[x] y\""),
    ] {
        let error = layout("a/A", text).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

proptest! {
    #[test]
    fn no_bytes_and_no_definition_make_it_panic(
        text in "((u?int(8|16|32|64)|string|A|a/B|time|Header)(\\[[0-9]{0,9}\\])? [a-z]{1,3}\n|={9}\nMSG: a/[AB]\n){0,12}",
        words in "\\PC{0,60}",
        data in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        for text in [&*text, &*words] {
            if let Ok(layout) = layout("a/A", text) {
                let _ = layout.read(&[&[0, 1, 0, 0], &data[..]].concat());
                let _ = layout.read(&data);
            }
        }
    }
}
