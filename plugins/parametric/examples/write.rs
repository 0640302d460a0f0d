//! Writes the generated files to a directory, to look at them or change them: `write OUT [OPTIONS.toml]`
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let written = match arguments.as_slice() {
        [out] => write(out, String::new()),
        [out, options] => std::fs::read_to_string(options)
            .map_err(|error| format!("{}: {error}", options.display()))
            .and_then(|text| write(out, text)),
        _ => Err("usage: write OUT [OPTIONS.toml]".to_owned()),
    };
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn write(out: &std::path::Path, options: String) -> Result<(), String> {
    let files = eigenhand_hand_parametric::generate(&options)?;
    std::fs::create_dir_all(out).map_err(|error| format!("{}: {error}", out.display()))?;
    files.iter().try_for_each(|(name, content)| {
        let path = out.join(name);
        std::fs::write(&path, content).map_err(|error| format!("{}: {error}", path.display()))
    })
}
