//! Packets that pyubx2 and pymavlink have written, with the numbers that they read from them: by tests/interop/receivers.py.

/// Packet of a published library.
pub struct Vector {
    pub message: String,
    pub bytes: Vec<u8>,
    pub numbers: Vec<(String, f64)>,
}

/// Returns the packets of a text.
pub fn read(text: &str) -> Vec<Vector> {
    text.lines()
        .map(|line| {
            let mut words = line.split(' ');
            let message = words.next().unwrap().to_owned();
            let hexadecimal = words.next().unwrap();
            let bytes = (0..hexadecimal.len() / 2)
                .map(|at| u8::from_str_radix(&hexadecimal[2 * at..2 * at + 2], 16).unwrap())
                .collect();
            let numbers = words
                .map(|word| word.split_once('=').unwrap())
                .map(|(name, number)| (name.to_owned(), number.parse().unwrap()))
                .collect();
            Vector {
                message,
                bytes,
                numbers,
            }
        })
        .collect()
}

/// Returns the committed packets: six of each message.
pub fn committed() -> Vec<Vector> {
    read(include_str!("../vectors/packets.txt"))
}
