//! The settings for people.

use std::fmt;
use std::time::Duration;

use comfy_table::{LineStyle, Table, TableStyle};

use crate::settings::{Cloud, CloudConnection, Settings};

/// A line below the header and no other lines.
const STYLE: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hosts = if self.localhost_only { "this machine only" } else { "all machines" };
        writeln!(f, "{} in domain {}, {hosts}", self.node.full(), self.domain)?;
        writeln!(f, "keys: {} of input, {} of output", self.input.key, self.output.key)?;
        writeln!(f, "deadlines: {}\n", self.deadlines)?;
        let mut topics = table(["topic", "over", "role", "type", "quality of service", "named by"]);
        for topic in &self.topics {
            topics.add_row([
                topic.name.clone(),
                self.middleware_of(&topic.name).to_string(),
                topic.role.to_string(),
                topic.type_name.clone(),
                topic.qos.to_string(),
                topic.purpose.clone(),
            ]);
        }
        print(f, &topics)?;
        if !self.clouds.is_empty() {
            let mut clouds = table(["cloud", "priority", "deadline", "asked", "reached by"]);
            for cloud in &self.clouds {
                clouds.add_row(self.cloud_row(cloud));
            }
            writeln!(f)?;
            print(f, &clouds)?;
        }
        let mut parameters = table(["parameter", "value", "from", "while running"]);
        for parameter in &self.declared {
            let change = if parameter.spec.at_run_time { "may change" } else { "fixed" };
            parameters.add_row([
                parameter.name.clone(),
                parameter.value.to_string(),
                parameter.origin.to_string(),
                change.to_owned(),
            ]);
        }
        writeln!(f)?;
        print(f, &parameters)?;
        Ok(())
    }
}

impl Settings {
    fn cloud_row(&self, cloud: &Cloud) -> [String; 5] {
        let connection = match &cloud.way {
            CloudConnection::Topics { input, output, .. } => format!("{input}, {output}"),
            CloudConnection::Grpc(grpc) => grpc.url.clone(),
        };
        let requested = if cloud.enabled { "yes" } else { "no" };
        let deadline = secs(cloud.deadline.unwrap_or(self.deadline));
        [cloud.name.clone(), cloud.priority.to_string(), deadline, requested.to_owned(), connection]
    }
}

fn secs(time: Duration) -> String {
    format!("{} s", time.as_secs_f64())
}

fn table<const N: usize>(header: [&str; N]) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE).set_header(header);
    table
}

/// Writes the table without blanks at the ends of lines.
fn print(f: &mut fmt::Formatter<'_>, table: &Table) -> fmt::Result {
    table.lines().try_for_each(|line| writeln!(f, "{}", line.trim_end()))
}
