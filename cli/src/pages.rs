//! `fuseline completions` and `fuseline man`: what a shell and `man` know of the command.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;

use crate::exit::Exit;
use crate::fault::Fault;
use crate::output::{Output, Overwrite};
use fuseline_evaluation::plot::Folder;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  fuseline completions bash > ~/.local/share/bash-completion/completions/fuseline
  fuseline completions zsh > ~/.zfunc/_fuseline
  fuseline completions fish > ~/.config/fish/completions/fuseline.fish")]
pub(crate) struct ShellArgs {
    /// The shell.
    shell: Shell,
}

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  fuseline man ~/.local/share/man/man1
  man fuseline-check")]
pub(crate) struct ManArgs {
    /// The folder; it must be empty or new, unless --force is given.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Prints what completes the command's words in a shell.
///
/// # Errors
/// If standard output cannot be written.
pub(crate) fn complete(args: &ShellArgs, mut command: Command) -> Result<Exit, Fault> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "fuseline", &mut script);
    let output = Output::new(Path::new("-"), &[], Overwrite::default())?;
    output.write(|out| out.write_all(&script).map_err(Fault::Output))?;
    Ok(Exit::Conforms)
}

/// Writes a page for each command.
///
/// # Errors
/// If the folder cannot be written.
pub(crate) fn manual(args: &ManArgs, mut command: Command) -> Result<Exit, Fault> {
    let Some(folder) = Folder::open(Some(&args.folder), args.overwrite.force)? else {
        return Ok(Exit::Conforms);
    };
    command = command.disable_help_subcommand(true);
    command.build();
    put(&command, "fuseline", &folder)?;
    Ok(Exit::Conforms)
}

/// Writes the pages of a command and of those below it.
fn put(command: &Command, name: &str, folder: &Folder) -> Result<(), Fault> {
    let mut page = Vec::new();
    let named = command.clone().display_name(name.to_owned());
    Man::new(named)
        .source(concat!("fuseline ", env!("CARGO_PKG_VERSION")))
        .render(&mut page)
        .map_err(Fault::Output)?;
    folder.put(&format!("{name}.1"), &page)?;
    for below in command.get_subcommands() {
        put(below, &format!("{name}-{}", below.get_name()), folder)?;
    }
    Ok(())
}
