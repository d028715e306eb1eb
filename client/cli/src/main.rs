//! The `lobula` binary.

fn main() -> std::process::ExitCode {
    lobula_cli::main(std::env::args_os())
}
