//! `iplw completions` and `iplw man`: shell completions and manual pages, generated from the command-line parser.

use std::path::{Path, PathBuf};

use clap_complete::Shell;
use iplw::error::{Error, Result};

use super::output;

/// Print a completion script for a shell.
///
/// Prints a completion script.
///
/// bash: `iplw completions bash > ~/.local/share/bash-completion/completions/iplw`.
/// zsh: `iplw completions zsh > ~/.zfunc/_iplw`, with ~/.zfunc in fpath.
/// fish: `iplw completions fish > ~/.config/fish/completions/iplw.fish`.
/// PowerShell: append the output of `iplw completions powershell` to $PROFILE.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct CompletionsArgs {
    /// Shell.
    shell: Shell,
}

/// Writes a manual page for the program and for each command: iplw.1, iplw-run.1, ...
#[derive(clap::Args)]
pub struct ManArgs {
    /// Output directory.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the completion script of `command`.
pub fn print_completions(args: &CompletionsArgs, mut command: clap::Command) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "iplw", &mut script);
    output::print(&String::from_utf8_lossy(&script))
}

/// Writes the manual pages of `command`.
pub fn write_man_pages(args: &ManArgs, command: clap::Command) -> Result<()> {
    output::prepare_directory("--out", &args.out)?;
    let mut command = command.disable_help_subcommand(true);
    command.build();
    write_man_page(&args.out, command)
}

/// Writes the page of a command and those of its subcommands.
fn write_man_page(directory: &Path, command: clap::Command) -> Result<()> {
    for sub in command.get_subcommands().filter(|s| !s.is_hide_set()) {
        write_man_page(directory, sub.clone())?;
    }
    let (mut text, page) = (Vec::new(), clap_mangen::Man::new(command));
    page.render(&mut text).map_err(|e| Error::io(directory, e))?;
    output::write_whole(&directory.join(page.get_filename()), &text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::command;

    #[test]
    fn parser_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_command_has_a_short_description() {
        for sub in command().get_subcommands() {
            let about = sub.get_about().map(ToString::to_string).unwrap_or_default();
            assert!(
                about.len() > 10 && about.len() < 120 && !about.contains('\n'),
                "{}: {about}",
                sub.get_name()
            );
        }
    }

    /// The common options are described in the program's help only.
    #[test]
    fn options_have_a_one_line_description() {
        for sub in command().get_subcommands() {
            for option in sub.get_arguments().filter(|a| !a.is_hide_set() && a.get_id() != "help") {
                let help = option.get_help().map(ToString::to_string).unwrap_or_default();
                assert!(
                    !help.is_empty() && help.len() <= 130,
                    "{} {}: {help}",
                    sub.get_name(),
                    option.get_id()
                );
            }
        }
    }

    #[test]
    fn completions_contain_all_visible_commands() {
        let names: Vec<String> = command()
            .get_subcommands()
            .filter(|c| !c.is_hide_set())
            .map(|c| c.get_name().to_string())
            .collect();
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::PowerShell, Shell::Elvish] {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut command(), "iplw", &mut script);
            let script = String::from_utf8(script).unwrap();
            assert!(names.iter().all(|name| script.contains(name)), "{shell}");
        }
    }

    #[test]
    fn writes_a_manual_page_for_each_command() {
        let folder = tempfile::tempdir().unwrap();
        write_man_pages(&ManArgs { out: folder.path().into() }, command()).unwrap();
        for page in ["iplw.1", "iplw-run.1", "iplw-diagnose.1", "iplw-token-new.1"] {
            assert!(folder.path().join(page).is_file(), "{page}");
        }
    }
}
