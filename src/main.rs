//! The program `city3d`; everything is in the library.

fn main() -> std::process::ExitCode {
    city3d::app::main()
}
