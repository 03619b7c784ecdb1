//! The clouds' processes and the network between them, in namespaces of this run's own. [`Testbed`]
//! breaks and repairs them.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, SystemTime};

use fuseline_tokio::Error;
use fuseline_tokio::grpc::Remote;
use rustix::process::{Pid, Signal, kill_process};

use crate::certificates::Ca;
use crate::disruption::{Disruption, ScheduledDisruption};

/// The port of the first cloud.
const PORT: u16 = 7000;

/// The last years of a good certificate and of an expired one.
const YEARS: (i32, i32) = (4000, 2020);

/// The clouds and the network. Dropping it leaves no process behind.
pub(crate) struct Testbed {
    folder: PathBuf,
    clouds: Vec<Child>,
    /// The file with the seconds by which the wall clock is off. The library that `.ci/chaos`
    /// preloads reads it.
    clock: PathBuf,
    ca: Ca,
}

impl Testbed {
    /// Starts this many clouds.
    ///
    /// # Errors
    /// Returns an error if this is not a separate namespace, or something that is needed is
    /// missing.
    pub(crate) fn new(folder: &Path, clouds: usize) -> Result<Self, Error> {
        let clock = std::env::var_os("CLOCK_OFFSET").ok_or("it is started by .ci/chaos")?;
        for rule in [
            "add table inet chaos",
            "add chain inet chaos arrives { type filter hook input priority 0; }",
        ] {
            run("nft", rule)?;
        }
        let ca = Ca::new()?;
        fs::write(folder.join("ca.pem"), &ca.certificate)?;
        let mut field =
            Self { folder: folder.to_owned(), clouds: Vec::new(), clock: clock.into(), ca };
        resolve(clouds, None)?;
        for cloud in 0..clouds {
            for (name, year) in [("good", YEARS.0), ("expired", YEARS.1)] {
                let identity = field.ca.sign(&host(cloud), year)?;
                fs::write(folder.join(format!("{name}-{cloud}.pem")), identity.certificate)?;
                fs::write(folder.join(format!("{name}-{cloud}.key")), identity.key)?;
            }
            let child = field.start(cloud, "good")?;
            field.clouds.push(child);
        }
        Ok(field)
    }

    /// Returns the address and the credentials with which an operator reaches a cloud.
    pub(crate) fn remote(&self, cloud: usize) -> Result<Remote, Error> {
        Ok(Remote {
            ca: Some(self.ca.certificate.clone()),
            identity: Some(self.ca.sign("vehicle", YEARS.0)?),
            ..Remote::new(format!("https://{}:{}", host(cloud), port(cloud)))
        })
    }

    pub(crate) const fn len(&self) -> usize {
        self.clouds.len()
    }

    /// Begins a disruption, which [`repair`](Self::repair) ends.
    pub(crate) fn disruption(&mut self, disruption: ScheduledDisruption) -> Result<(), Error> {
        let (cloud, port) = (disruption.cloud, port(disruption.cloud));
        match disruption.harm {
            Disruption::Kill => self.kill(cloud)?,
            Disruption::Stop => self.signal(cloud, Signal::STOP)?,
            // The resets themselves must get through.
            Disruption::Reset => nft(port, "tcp flags & rst != rst reject with tcp reset")?,
            Disruption::BlackHole => nft(port, "drop")?,
            Disruption::Loss => nft(port, "numgen random mod 100 < 20 drop")?,
            Disruption::Slow => {
                run("tc", "qdisc add dev lo root tbf rate 1mbit burst 64kb latency 400ms")?;
            }
            Disruption::Latency => self.report(cloud, "150"),
            Disruption::Step => self.report(cloud, "40"),
            Disruption::Dns => {
                resolve(self.clouds.len(), Some(cloud))?;
                self.kill(cloud)?;
                self.clouds[cloud] = self.start(cloud, "good")?;
            }
            Disruption::Expired => {
                self.kill(cloud)?;
                self.clouds[cloud] = self.start(cloud, "expired")?;
            }
            Disruption::ClockBack => self.step("-3600")?,
            Disruption::ClockAhead => self.step("+3600")?,
        }
        Ok(())
    }

    /// Ends a disruption.
    pub(crate) fn repair(&mut self, disruption: ScheduledDisruption) -> Result<(), Error> {
        let cloud = disruption.cloud;
        match disruption.harm {
            Disruption::Kill => self.clouds[cloud] = self.start(cloud, "good")?,
            Disruption::Stop => self.signal(cloud, Signal::CONT)?,
            Disruption::Reset | Disruption::BlackHole | Disruption::Loss => {
                run("nft", "flush chain inet chaos arrives")?;
            }
            Disruption::Slow => run("tc", "qdisc del dev lo root")?,
            Disruption::Latency | Disruption::Step => self.report(cloud, "0"),
            Disruption::Dns => resolve(self.clouds.len(), None)?,
            Disruption::Expired => {
                self.kill(cloud)?;
                self.clouds[cloud] = self.start(cloud, "good")?;
            }
            Disruption::ClockBack | Disruption::ClockAhead => self.step("+0000")?,
        }
        Ok(())
    }

    fn start(&self, cloud: usize, name: &str) -> Result<Child, Error> {
        let child = Command::new(std::env::current_exe()?)
            .args(["cloud", "--listen", &format!("127.0.0.1:{}", port(cloud))])
            .args(["--number", &cloud.to_string(), "--name", &format!("{name}-{cloud}")])
            .arg("--folder")
            .arg(&self.folder)
            .stdin(Stdio::piped())
            .spawn()?;
        Ok(child)
    }

    fn kill(&mut self, cloud: usize) -> Result<(), Error> {
        self.clouds[cloud].kill()?;
        self.clouds[cloud].wait()?;
        Ok(())
    }

    fn signal(&self, cloud: usize, signal: Signal) -> Result<(), Error> {
        let pid = Pid::from_child(&self.clouds[cloud]);
        Ok(kill_process(pid, signal)?)
    }

    /// Sets the seconds by which the wall clock is off. All texts have the same length, so a
    /// concurrent reader always reads a number.
    fn step(&self, by: &str) -> Result<(), Error> {
        let before = SystemTime::now();
        fs::write(&self.clock, by)?;
        let after = SystemTime::now();
        let stepped = after.duration_since(before).unwrap_or_else(|back| back.duration());
        let far = stepped > Duration::from_secs(3000);
        far.then_some(()).ok_or_else(|| "the wall clock did not step".into())
    }

    /// Adds a delay to a cloud. A cloud that is dead reads nothing.
    fn report(&mut self, cloud: usize, delay_ms: &str) {
        if let Some(stdin) = &mut self.clouds[cloud].stdin {
            let _ = writeln!(stdin, "{delay_ms}");
        }
    }
}

impl Drop for Testbed {
    fn drop(&mut self) {
        for cloud in &mut self.clouds {
            let _ = cloud.kill();
            let _ = cloud.wait();
        }
    }
}

/// Makes the names of all clouds resolvable, except the name of `but`.
fn resolve(clouds: usize, but: Option<usize>) -> Result<(), Error> {
    let known = (0..clouds).filter(|cloud| Some(*cloud) != but);
    let lines: Vec<String> = known.map(|cloud| format!("127.0.0.1 {}\n", host(cloud))).collect();
    Ok(fs::write("/etc/hosts", lines.concat())?)
}

fn host(cloud: usize) -> String {
    format!("cloud-{cloud}.test")
}

fn port(cloud: usize) -> u16 {
    PORT + u16::try_from(cloud).unwrap_or(u16::MAX - PORT)
}

/// Sets what happens to packets to and from a port.
fn nft(port: u16, verdict: &str) -> Result<(), Error> {
    run("nft", &format!("add rule inet chaos arrives tcp dport {port} {verdict}"))?;
    run("nft", &format!("add rule inet chaos arrives tcp sport {port} {verdict}"))
}

fn run(tool: &str, words: &str) -> Result<(), Error> {
    let done = Command::new(tool).args(words.split(' ')).output();
    let done = done.map_err(|error| format!("{tool}: {error}"))?;
    let stderr = String::from_utf8_lossy(&done.stderr);
    done.status.success().then_some(()).ok_or_else(|| format!("{tool} {words}: {stderr}").into())
}
