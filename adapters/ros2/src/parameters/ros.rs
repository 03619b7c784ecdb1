//! Values as ROS has them in its services.

use ros2_client::ParameterValue;
use ros2_client::parameters::raw;

use super::Value;

/// Returns a value in the form of ROS.
pub(crate) fn value(value: &Value) -> raw::ParameterValue {
    let value = match value.clone() {
        Value::Bool(value) => ParameterValue::Boolean(value),
        Value::Integer(value) => ParameterValue::Integer(value),
        Value::Double(value) => ParameterValue::Double(value),
        Value::String(value) => ParameterValue::String(value),
        Value::Bools(values) => ParameterValue::BooleanArray(values),
        Value::Integers(values) => ParameterValue::IntegerArray(values),
        Value::Doubles(values) => ParameterValue::DoubleArray(values),
        Value::Strings(values) => ParameterValue::StringArray(values),
    };
    value.into()
}

/// Returns the value that ROS means; none if no parameter of this node has its type.
pub(super) fn read(value: raw::ParameterValue) -> Option<Value> {
    match value.into() {
        ParameterValue::Boolean(value) => Some(Value::Bool(value)),
        ParameterValue::Integer(value) => Some(Value::Integer(value)),
        ParameterValue::Double(value) => Some(Value::Double(value)),
        ParameterValue::String(value) => Some(Value::String(value)),
        ParameterValue::BooleanArray(values) => Some(Value::Bools(values)),
        ParameterValue::IntegerArray(values) => Some(Value::Integers(values)),
        ParameterValue::DoubleArray(values) => Some(Value::Doubles(values)),
        ParameterValue::StringArray(values) => Some(Value::Strings(values)),
        ParameterValue::NotSet | ParameterValue::ByteArray(_) => None,
    }
}
