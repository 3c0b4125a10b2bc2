#![no_main]

use libfuzzer_sys::fuzz_target;
use motion_capture::natnet::{Decoder, ServerInfo, Version};
use motion_capture::{sender, wire::Frame};

/// Every version of the bit stream, with and without having heard the names.
fuzz_target!(|bytes: &[u8]| {
    let mut frame = Frame::new();
    let _ = Decoder::new().decode(bytes, &mut frame);
    for (major, minor) in [(3, 1), (4, 0), (4, 1)] {
        let info = ServerInfo {
            version: Version { major, minor },
            clock_frequency: 10_000_000,
            data_port: 1511,
            multicast: None,
        };
        let mut decoder = Decoder::new();
        let greeting = sender::natnet::server_info(&info);
        assert!(decoder.decode(&greeting, &mut frame).is_ok());
        for _ in 0..2 {
            let _ = decoder.decode(bytes, &mut frame);
            motion_capture_fuzz::check(&frame);
        }
    }
});
