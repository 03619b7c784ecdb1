//! Values, read from YAML as rcl reads them.

use std::fmt::{self, Write as _};

use crate::parameters::ParameterFlaw;
use crate::parameters::yaml::{Content, Node, Position};

/// A parameter's value, of one of ROS's types.
#[derive(Clone, PartialEq, Debug)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number with a point or an exponent.
    Double(f64),
    /// Text.
    String(String),
    /// A list of `true` and `false`.
    Bools(Vec<bool>),
    /// A list of whole numbers.
    Integers(Vec<i64>),
    /// A list of numbers.
    Doubles(Vec<f64>),
    /// A list of texts; also the empty list.
    Strings(Vec<String>),
}

impl Value {
    /// Returns the value as a number, if it is a double or an integer.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Double(double) => Some(*double),
            #[expect(clippy::cast_precision_loss, reason = "less than one part in 1e15 is lost")]
            Self::Integer(integer) => Some(*integer as f64),
            _ => None,
        }
    }
}

pub(super) type FlawResult<T> = Result<T, (Position, ParameterFlaw)>;

/// Reads the value of the parameter `name`.
pub(super) fn read(name: &str, node: &Node) -> FlawResult<Value> {
    let read = match &node.content {
        Content::Scalar { text, is_plain: false } => return Ok(Value::String(text.clone())),
        Content::Scalar { text, is_plain: true } => {
            return plain(text).ok_or_else(|| (node.mark, ParameterFlaw::Empty(name.to_owned())));
        }
        Content::List(list) => {
            let values = list.iter().map(|node| read(name, node)).collect::<Result<Vec<_>, _>>()?;
            list_of(values)
        }
        Content::Mapping(_) => return Err((node.mark, ParameterFlaw::Mapping(name.to_owned()))),
    };
    read.ok_or_else(|| (node.mark, ParameterFlaw::List(name.to_owned())))
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(bool) => bool.fmt(f),
            Self::Integer(integer) => integer.fmt(f),
            Self::Double(double) => write!(f, "{:?}", YamlDisplay(double)),
            Self::String(string) => write!(f, "{:?}", YamlDisplay(string)),
            Self::Bools(list) => write!(f, "{list:?}"),
            Self::Integers(list) => write!(f, "{list:?}"),
            Self::Doubles(list) => f.debug_list().entries(list.iter().map(YamlDisplay)).finish(),
            Self::Strings(list) => f.debug_list().entries(list.iter().map(YamlDisplay)).finish(),
        }
    }
}

/// A value as YAML, in one line of printable characters.
struct YamlDisplay<'a, T>(&'a T);

impl fmt::Debug for YamlDisplay<'_, f64> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self.0 {
            number if number.is_nan() => f.write_str(".nan"),
            f64::INFINITY => f.write_str(".inf"),
            f64::NEG_INFINITY => f.write_str("-.inf"),
            number => write!(f, "{number:?}"),
        }
    }
}

impl fmt::Debug for YamlDisplay<'_, String> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_char('"')?;
        for c in self.0.chars() {
            let is_printable = c == '\'' || c.escape_debug().len() == 1;
            match c {
                '\n' => f.write_str("\\n")?,
                '\t' => f.write_str("\\t")?,
                '"' | '\\' => write!(f, "\\{c}")?,
                c if is_printable => f.write_char(c)?,
                c => write!(f, "\\U{:08x}", u32::from(c))?,
            }
        }
        f.write_char('"')
    }
}

/// Returns the value of text without quotes; none for null.
///
/// The words for true and false are as in YAML 1.1; `0x` and `0` begin hexadecimal and octal
/// integers.
fn plain(text: &str) -> Option<Value> {
    match text {
        "" | "~" | "null" | "Null" | "NULL" => return None,
        "y" | "Y" | "yes" | "Yes" | "YES" | "true" | "True" | "TRUE" | "on" | "On" | "ON" => {
            return Some(Value::Bool(true));
        }
        "n" | "N" | "no" | "No" | "NO" | "false" | "False" | "FALSE" | "off" | "Off" | "OFF" => {
            return Some(Value::Bool(false));
        }
        ".nan" | ".NaN" | ".NAN" => return Some(Value::Double(f64::NAN)),
        ".inf" | ".Inf" | ".INF" | "+.inf" | "+.Inf" | "+.INF" => {
            return Some(Value::Double(f64::INFINITY));
        }
        "-.inf" | "-.Inf" | "-.INF" => return Some(Value::Double(f64::NEG_INFINITY)),
        _ => {}
    }
    if let Some(integer) = integer(text) {
        return Some(Value::Integer(integer));
    }
    // Words that Rust reads as numbers, such as nan, are text here.
    let double = text.parse().ok().filter(|_| text.contains(|c: char| c.is_ascii_digit()));
    Some(double.map_or_else(|| Value::String(text.to_owned()), Value::Double))
}

fn integer(text: &str) -> Option<i64> {
    let (sign, digits) = match text.strip_prefix(['-', '+']) {
        Some(digits) => (&text[..1], digits),
        None => ("", text),
    };
    let (radix, digits) = if let Some(digits) = digits.strip_prefix("0x") {
        (16, digits)
    } else if digits.len() > 1 && digits.starts_with('0') {
        (8, digits)
    } else {
        (10, digits)
    };
    let is_digit = |c: char| c.is_digit(radix);
    if digits.is_empty() || !digits.chars().all(is_digit) {
        return None;
    }
    i64::from_str_radix(&format!("{sign}{digits}"), radix).ok()
}

/// Returns a list, if all values are of one type and are not lists themselves.
fn list_of(values: Vec<Value>) -> Option<Value> {
    let mut values = values.into_iter();
    let mut list = match values.next() {
        None => Value::Strings(Vec::new()),
        Some(Value::Bool(first)) => Value::Bools(vec![first]),
        Some(Value::Integer(first)) => Value::Integers(vec![first]),
        Some(Value::Double(first)) => Value::Doubles(vec![first]),
        Some(Value::String(first)) => Value::Strings(vec![first]),
        Some(Value::Bools(_) | Value::Integers(_) | Value::Doubles(_) | Value::Strings(_)) => {
            return None;
        }
    };
    for value in values {
        match (&mut list, value) {
            (Value::Bools(list), Value::Bool(next)) => list.push(next),
            (Value::Integers(list), Value::Integer(next)) => list.push(next),
            (Value::Doubles(list), Value::Double(next)) => list.push(next),
            (Value::Strings(list), Value::String(next)) => list.push(next),
            _ => return None,
        }
    }
    Some(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_text_has_the_type_that_rcl_gives_it() {
        let cases = [
            ("yes", Value::Bool(true)),
            ("OFF", Value::Bool(false)),
            ("12", Value::Integer(12)),
            ("-0x1f", Value::Integer(-31)),
            ("010", Value::Integer(8)),
            ("0", Value::Integer(0)),
            ("-9223372036854775808", Value::Integer(i64::MIN)),
            ("9223372036854775808", Value::Double(9_223_372_036_854_775_808.0)),
            ("0.5", Value::Double(0.5)),
            (".5", Value::Double(0.5)),
            ("1e-3", Value::Double(0.001)),
            ("-.inf", Value::Double(f64::NEG_INFINITY)),
            ("inf", Value::String("inf".to_owned())),
            ("nan", Value::String("nan".to_owned())),
            ("+-1", Value::String("+-1".to_owned())),
            ("0x", Value::String("0x".to_owned())),
            ("-", Value::String("-".to_owned())),
            ("west", Value::String("west".to_owned())),
        ];
        for (text, value) in cases {
            assert_eq!(plain(text), Some(value), "{text}");
        }
        assert_eq!(plain("~"), None);
        assert!(matches!(plain(".nan"), Some(Value::Double(nan)) if nan.is_nan()));
    }

    #[test]
    fn values_are_shown_as_yaml() {
        let cases = [
            (Value::Bool(true), "true"),
            (Value::Integer(-1), "-1"),
            (Value::Double(1.0), "1.0"),
            (Value::String("a \"b\"".to_owned()), r#""a \"b\"""#),
            (
                Value::String("it's\n\u{1b}\u{200b}é\\".to_owned()),
                r#""it's\n\U0000001b\U0000200bé\\""#,
            ),
            (Value::Double(f64::NAN), ".nan"),
            (Value::Doubles(vec![f64::INFINITY, f64::NEG_INFINITY]), "[.inf, -.inf]"),
            (Value::Strings(vec!["a".to_owned(), "b".to_owned()]), "[\"a\", \"b\"]"),
            (Value::Doubles(vec![0.5, 2.0]), "[0.5, 2.0]"),
            (Value::Bools(vec![true]), "[true]"),
            (Value::Integers(Vec::new()), "[]"),
        ];
        for (value, text) in cases {
            assert_eq!(value.to_string(), text);
        }
    }
}
