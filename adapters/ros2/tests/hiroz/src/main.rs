//! A graph of ROS 2 over Zenoh around the node, whose peers are of hiroz: a second implementation of `rmw_zenoh`'s format,
//! which shares no code with the node above Zenoh itself. `../run` builds all and plays it.
//!
//! ```sh
//! fuseline-ros2-hiroz scene NODE FUSELINE FOLDER    # is camera and subscriber, starts all others, and judges
//! fuseline-ros2-hiroz router                        # through which they meet
//! fuseline-ros2-hiroz local                         # or west, a cloud: answers each image
//! ```

mod book;
mod image;
mod part;
mod peers;
mod graph_scene;

use std::env;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// Whatever went wrong.
type Any = Box<dyn Error + Send + Sync>;

fn main() -> ExitCode {
    let words: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let ended = match words[..] {
        ["scene", node, fuseline, folder] => graph_scene::play(node, fuseline, Path::new(folder)),
        ["router"] => peers::route(),
        [source @ ("local" | "west")] => peers::answer(source),
        _ => Err("give scene NODE FUSELINE FOLDER, router, local or west".into()),
    };
    if let Err(error) = ended {
        eprintln!("error: {}: {error}", words.first().unwrap_or(&"what"));
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}
