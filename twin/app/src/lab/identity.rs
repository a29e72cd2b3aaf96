//! Identity of a build: `ftac` runs only an `ftac-lab` that has the same commands, options and output.

use clap::Command;

use crate::commands::schema::OUTPUTS;
use crate::json_schema;

/// Number of hexadecimal digits of the digest.
const DIGEST_DIGITS: usize = 16;

/// Returns the package version and a digest of the help of `command` with all its subcommands, and of the schemas of
/// the JSON output of `ftac`.
pub fn identity(mut command: Command) -> String {
    command.build();
    let mut text = json_schema::all_schemas(OUTPUTS.iter().copied()).to_string();
    add_help(&mut command, &mut text);
    format!("{} {}", env!("CARGO_PKG_VERSION"), &ftac_platform::digest::sha256(text.as_bytes())[..DIGEST_DIGITS])
}

fn add_help(command: &mut Command, text: &mut String) {
    *text += &command.render_long_help().to_string();
    command.get_subcommands_mut().for_each(|command| add_help(command, text));
}
