//! The six services by which `ros2 param` sees and sets the parameters of a node that runs.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use fuseline_engine::lock;
use ros2_client::parameters::raw::{
    FloatingPointRange, IntegerRange, Parameter as Raw, ParameterDescriptor, ParameterValue,
    SetParametersResult,
};
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, ListParametersResult, SetParametersAtomicallyResponse,
    SetParametersRequest, SetParametersResponse,
};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tracing::info;

use super::{Value, ros};
use crate::error::NodeError;
use crate::middleware::{Graph, TypeName};
use crate::service::Requests;
use crate::settings::{Change, Kind, Parameter, Settings};

/// The services, and what comes on them.
pub(crate) struct ParameterServices {
    get: Requests<GetParametersRequest, GetParametersResponse>,
    types: Requests<GetParameterTypesRequest, GetParameterTypesResponse>,
    set: Requests<SetParametersRequest, SetParametersResponse>,
    set_all: Requests<SetParametersRequest, SetParametersAtomicallyResponse>,
    list: Requests<ListParametersRequest, ListParametersResponse>,
    describe: Requests<DescribeParametersRequest, DescribeParametersResponse>,
}

/// Gets each parameter that was set: its name and its value.
pub(crate) type ParameterCallback = Box<dyn Fn(&str, &Value) + Send + Sync>;

/// The parameters of a node that runs.
pub(crate) struct NodeParameters {
    /// The settings with what was set since the start.
    pub(crate) settings: Arc<Mutex<Settings>>,
    /// Gets each change.
    pub(crate) setter: mpsc::UnboundedSender<Change>,
    /// Gets each parameter that was set.
    pub(crate) set: ParameterCallback,
}

impl ParameterServices {
    /// Offers them.
    pub(crate) fn offer(graph: &mut Graph, tasks: &mut JoinSet<()>) -> Result<Self, NodeError> {
        let ty = |name| TypeName { package: "rcl_interfaces", name };
        Ok(Self {
            get: graph.serve("get_parameters", ty("GetParameters"), tasks)?,
            types: graph.serve("get_parameter_types", ty("GetParameterTypes"), tasks)?,
            set: graph.serve("set_parameters", ty("SetParameters"), tasks)?,
            set_all: graph.serve(
                "set_parameters_atomically",
                ty("SetParametersAtomically"),
                tasks,
            )?,
            list: graph.serve("list_parameters", ty("ListParameters"), tasks)?,
            describe: graph.serve("describe_parameters", ty("DescribeParameters"), tasks)?,
        })
    }

    /// Answers until no request can come.
    pub(crate) async fn run(mut self, parameters: NodeParameters) {
        loop {
            tokio::select! {
                Some(requested) = self.get.recv() => requested.answer(|requested| GetParametersResponse {
                    values: requested.names.iter().map(|name| parameters.value(name)).collect(),
                }),
                Some(requested) = self.types.recv() => requested.answer(|requested| GetParameterTypesResponse {
                    values: requested.names.iter().map(|name| parameters.value(name).ptype).collect(),
                }),
                Some(requested) = self.set.recv() => requested.answer(|requested| SetParametersResponse {
                    results: requested.parameter.into_iter().map(|it| parameters.set(vec![it])).collect(),
                }),
                Some(requested) = self.set_all.recv() => {
                    requested.answer(|requested| SetParametersAtomicallyResponse {
                        result: parameters.set(requested.parameter),
                    });
                }
                Some(requested) = self.list.recv() => requested.answer(|requested| ListParametersResponse {
                    result: parameters.list(&requested),
                }),
                Some(requested) = self.describe.recv() => {
                    requested.answer(|requested| DescribeParametersResponse {
                        values: requested.names.iter().map(|name| parameters.describe(name)).collect(),
                    });
                }
                else => break,
            }
        }
    }
}

impl NodeParameters {
    fn value(&self, name: &str) -> ParameterValue {
        let settings = lock(&self.settings);
        settings.parameter(name).map_or_else(not_set, |found| ros::value(&found.value))
    }

    /// Sets all of them or none.
    fn set(&self, requested: Vec<Raw>) -> SetParametersResult {
        let mut settings = lock(&self.settings);
        let mut next = settings.clone();
        let mut changes = Vec::with_capacity(requested.len());
        for Raw { name, value } in requested {
            let checked = match ros::read(value) {
                Some(value) => next.change(&name, value).map_err(|error| error.to_string()),
                None => {
                    Err(format!("{name}: the value has a type that no parameter of this node has"))
                }
            };
            match checked {
                Ok((change, value)) => changes.push((name, change, value)),
                Err(reason) => return SetParametersResult { successful: false, reason },
            }
        }
        *settings = next;
        drop(settings);
        for (name, change, value) in changes {
            info!(%name, %value, "set");
            (self.set)(&name, &value);
            // The node may be ending.
            let _ = self.setter.send(change);
        }
        SetParametersResult { successful: true, reason: String::new() }
    }

    /// Lists parameters as rclcpp does: `depth` counts parts between dots, and 0 is any number.
    fn list(&self, requested: &ListParametersRequest) -> ListParametersResult {
        let is_within = |rest: &str| {
            requested.depth == 0 || (rest.matches('.').count() as u64) < requested.depth
        };
        let is_listed = |name: &str| {
            requested.prefixes.is_empty() && is_within(name)
                || requested.prefixes.iter().any(|prefix| {
                    match name.strip_prefix(prefix.as_str()) {
                        Some("") => true,
                        Some(rest) => rest.strip_prefix('.').is_some_and(is_within),
                        None => false,
                    }
                })
        };
        let settings = lock(&self.settings);
        let names = settings.declared.iter().map(|parameter| parameter.name.clone());
        let names: Vec<String> = names.filter(|name| is_listed(name)).collect();
        let prefixes = names.iter().filter_map(|name| name.rsplit_once('.'));
        let prefixes: BTreeSet<String> = prefixes.map(|(prefix, _)| prefix.to_owned()).collect();
        ListParametersResult { names, prefixes: prefixes.into_iter().collect() }
    }

    fn describe(&self, name: &str) -> ParameterDescriptor {
        let settings = lock(&self.settings);
        let mut descriptor = ParameterDescriptor {
            name: name.to_owned(),
            r#type: not_set().ptype,
            description: "there is no such parameter".to_owned(),
            additional_constraints: String::new(),
            read_only: true,
            dynamic_typing: false,
            floating_point_range: Vec::new(),
            integer_range: Vec::new(),
        };
        let Some(Parameter { value, spec, .. }) = settings.parameter(name) else {
            return descriptor;
        };
        let greatest = settings.greatest_deadline;
        descriptor.r#type = ros::value(value).ptype;
        spec.about.clone_into(&mut descriptor.description);
        descriptor.additional_constraints = spec.kind.expected(greatest);
        descriptor.read_only = !spec.at_run_time;
        if let Kind::Integer(from_value, to_value) = spec.kind {
            descriptor.integer_range.push(IntegerRange { from_value, to_value, step: 1 });
        } else if let Some(longest) = spec.kind.longest(greatest) {
            // A step of 0 is any step.
            let range =
                FloatingPointRange { from_value: 0.0, to_value: longest.as_secs_f64(), step: 0.0 };
            descriptor.floating_point_range.push(range);
        }
        descriptor
    }
}

/// Returns the value of a parameter that does not exist.
fn not_set() -> ParameterValue {
    ros2_client::ParameterValue::NotSet.into()
}
