//! Prints a line `name=digest` for every stage.

mod bits;

fn main() {
    bits::each(&mut bits::Memory::new(), |name, digest| println!("{name}={digest:016x}"));
}
