//! The program `city3d`; the crate `city3d-cli` has its commands.

fn main() -> std::process::ExitCode {
    city3d_cli::main()
}
