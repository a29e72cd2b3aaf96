//! More than a million damaged streams, drawn with a seed, for the decoders of the camera board and of the arm: none may
//! panic, pass a damaged frame as a good one, or lose more than the damage hit. The decoder of the servo bus is fuzzed in
//! `dynamixel-bus`, the session reader in `session_log/damage.rs`.

use hardware_bridge::tactile_link::deframer::Deframer;
use hardware_bridge::tactile_link::frame;
use hardware_bridge::tactile_link::image_data;
use hardware_bridge::tactile_link::message::{CameraFault, LinkImage, LinkMessage, PixelEncoding};
use kinova_kortex::frame::Frame;
use kinova_kortex::tcp_framing;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STREAM_COUNT: usize = 400_000;

/// Kind of damage to a packet's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Damage {
    /// Up to 16 consecutive bits before the last two bytes; the first and the last of them are changed.
    Burst,
    Overwritten,
    Inserted,
    Deleted,
    Cut,
}

const DAMAGES: [Damage; 5] = [Damage::Burst, Damage::Overwritten, Damage::Inserted, Damage::Deleted, Damage::Cut];

fn some_bytes(rng: &mut ChaCha8Rng, longest: usize) -> Vec<u8> {
    // Bytes that have a meaning in a framing come often.
    let byte = |rng: &mut ChaCha8Rng| match rng.random_range(0..4) {
        0 => [0x00, 0xFF, 0xFD, 0x55][rng.random_range(0..4)],
        _ => rng.random(),
    };
    (0..rng.random_range(0..=longest)).map(|_| byte(rng)).collect()
}

/// Damages `wire` from byte `first` on.
fn damage(rng: &mut ChaCha8Rng, wire: &mut Vec<u8>, first: usize, kind: Damage) {
    let place = rng.random_range(first..wire.len());
    match kind {
        Damage::Burst => {
            let bits = 8 * (wire.len() - 2 - first);
            let length = rng.random_range(1..=16).min(bits);
            let start = 8 * first + rng.random_range(0..=bits - length);
            for n in 0..length {
                if n == 0 || n == length - 1 || rng.random_bool(0.5) {
                    // Bits are counted as on the servos' line: high bits of a byte belong to the CRC's earlier powers.
                    wire[(start + n) / 8] ^= 0x80 >> ((start + n) % 8);
                }
            }
        }
        Damage::Overwritten => {
            for byte in wire[place..].iter_mut().take(rng.random_range(1..8)) {
                *byte = rng.random();
            }
        }
        Damage::Inserted => {
            let bytes = some_bytes(rng, 12);
            wire.splice(place..place, bytes);
        }
        Damage::Deleted => drop(wire.drain(place..(place + rng.random_range(1..6)).min(wire.len()))),
        Damage::Cut => wire.truncate(place),
    }
}

fn message(rng: &mut ChaCha8Rng) -> LinkMessage {
    match rng.random_range(0..7) {
        0 => LinkMessage::Hello,
        1 => LinkMessage::Welcome { version: rng.random(), serial: rng.random(), cameras: rng.random() },
        2 => LinkMessage::WhatTime { host_us: rng.random() },
        3 => LinkMessage::Time { host_us: rng.random(), board_us: rng.random() },
        4 => LinkMessage::Capture,
        5 => LinkMessage::CameraFault { camera: rng.random(), fault: CameraFault::Timeout },
        _ => LinkMessage::Image(LinkImage {
            camera: rng.random_range(0..18),
            sequence: rng.random(),
            captured_us: rng.random(),
            width: 240,
            height: 240,
            encoding: if rng.random() { PixelEncoding::Jpeg } else { PixelEncoding::Rgb565 },
            data: some_bytes(rng, 300),
        }),
    }
}

#[test]
fn tactile_link() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut images = 0;
    for n in 0..STREAM_COUNT {
        let sent: Vec<LinkMessage> = (0..rng.random_range(1..=4)).map(|_| message(&mut rng)).collect();
        let hit = rng.random_range(0..sent.len());
        let kind = DAMAGES[n % DAMAGES.len()];
        let mut stream = Vec::new();
        for (place, message) in sent.iter().enumerate() {
            let mut wire = frame::encode(message);
            if place == hit {
                damage(&mut rng, &mut wire, 0, kind);
            }
            stream.extend(wire);
        }
        let mut deframer = Deframer::default();
        let piece = rng.random_range(1..=100);
        let found: Vec<LinkMessage> = stream.chunks(piece).flat_map(|piece| deframer.push(piece)).flatten().collect();
        for message in &found {
            if let LinkMessage::Image(image) = message {
                // Random bytes are no picture: decoding must fail, not panic.
                images += usize::from(image_data::decode(image).is_err());
            }
        }
        // Damage at a delimiter joins a frame with the next one; everything else must be there, and nothing more.
        let without = |lost: &[usize]| -> Vec<&LinkMessage> {
            sent.iter().enumerate().filter(|(place, _)| !lost.contains(place)).map(|(_, message)| message).collect()
        };
        let possible = [without(&[hit]), without(&[hit, hit + 1]), without(&[])];
        assert!(
            possible.iter().any(|possible| found.iter().eq(possible.iter().copied())),
            "stream {n}, {kind:?}: {found:?} of {sent:?}"
        );
    }
    assert!(images > STREAM_COUNT / 10, "{images} images judged");
}

fn arm_frame(rng: &mut ChaCha8Rng) -> Frame {
    use kinova_kortex::call;
    use kinova_kortex::frame::{FrameKind, Header};
    let kind = [FrameKind::Request, FrameKind::Response, FrameKind::Notification][rng.random_range(0..3)];
    let call = [call::REFRESH, call::REFRESH_FEEDBACK, call::KEEP_ALIVE][rng.random_range(0..3)];
    let (error, sub_error) = (rng.random_range(0..16), rng.random_range(0..4096));
    let header =
        Header { kind, device: rng.random(), error, sub_error, session: rng.random(), message: rng.random(), call };
    Frame { header, payload: some_bytes(rng, 80) }
}

/// Kortex frames carry no checksum: UDP and TCP have theirs. The test requires that no bytes panic, that whatever is
/// accepted as a frame is the same when encoded again, and that frames before the damage in a stream come out.
#[test]
fn arm_protocol() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut taken, mut refused) = (0, 0);
    for n in 0..STREAM_COUNT {
        let sent: Vec<Frame> = (0..rng.random_range(1..=3)).map(|_| arm_frame(&mut rng)).collect();
        let hit = rng.random_range(0..sent.len());
        let kind = DAMAGES[n % DAMAGES.len()];
        let mut datagram = sent[hit].encode();
        damage(&mut rng, &mut datagram, 0, kind);
        for bytes in [datagram, some_bytes(&mut rng, 60)] {
            match Frame::decode(&bytes) {
                Ok(frame) => {
                    taken += 1;
                    assert_eq!(Frame::decode(&frame.encode()), Ok(frame), "stream {n}");
                }
                Err(_) => refused += 1,
            }
        }
        let mut stream = Vec::new();
        for (place, frame) in sent.iter().enumerate() {
            let mut wire = tcp_framing::encode(frame);
            if place == hit {
                damage(&mut rng, &mut wire, 0, kind);
            }
            stream.extend(wire);
        }
        let mut deframer = tcp_framing::Deframer::default();
        let mut found = Vec::new();
        let piece = rng.random_range(1..=50);
        'stream: for piece in stream.chunks(piece) {
            deframer.push(piece);
            loop {
                match deframer.next_frame() {
                    Ok(Some(frame)) => found.push(frame),
                    Ok(None) => break,
                    // An error means that the connection is given up.
                    Err(_) => break 'stream,
                }
            }
        }
        assert!(found.starts_with(&sent[..hit]), "stream {n}, {kind:?}: {found:?} of {sent:?}");
    }
    assert!(taken > STREAM_COUNT / 20 && refused > STREAM_COUNT / 2, "{taken} taken, {refused} refused");
}
