use dynamixel_bus::protocol2::Decoder;
use proptest::prelude::*;

use super::*;

const BAUD: u32 = 3_000_000;

fn chain(faults: &[&str]) -> ServoChain {
    let servos = (1..=6).map(|id| EmulatedServo::provisioned(id, 0)).collect();
    ServoChain::new(servos, Faults::parse(faults.iter().copied()).expect("faults"), 0.0, 1)
}

fn ask(chain: &mut ServoChain, id: u8, instruction: Instruction, now: f64) -> Vec<Status> {
    let wire = instruction.encode(id).expect("fits");
    let mut decoder = Decoder::default();
    decoder.push(&wire);
    let packet = decoder.next_packet().expect("whole").expect("good");
    let answers = chain.handle(&packet, wire.len(), BAUD, now);
    answers.iter().for_each(|answer| decoder.push(&answer.bytes));
    decoder.time_out().into_iter().flatten().filter_map(|packet| Status::decode(&packet)).collect()
}

fn ids(statuses: &[Status]) -> Vec<u8> {
    statuses.iter().map(|status| status.id).collect()
}

#[test]
fn broadcast_ping_and_single_reads() {
    let mut chain = chain(&[]);
    assert_eq!(ids(&ask(&mut chain, BROADCAST_ID, Instruction::Ping, 0.0)), [1, 2, 3, 4, 5, 6]);
    let model = ask(&mut chain, 3, Instruction::Read { address: 0, length: 2 }, 0.0);
    assert_eq!((model[0].id, &model[0].data[..]), (3, &xc330::MODEL.number.to_le_bytes()[..]));
    assert_eq!(ids(&ask(&mut chain, 9, Instruction::Ping, 0.0)), [0_u8; 0]);
}

#[test]
fn other_rates_are_not_understood() {
    let mut chain = chain(&[]);
    let packet = Packet { id: 1, instruction: 1, parameters: vec![] };
    assert!(chain.handle(&packet, 10, 57_600, 0.0).is_empty());
}

#[test]
fn an_unplugged_servo_silences_those_after_it() {
    let mut chain = chain(&["unplug=3@1"]);
    let read = || Instruction::SyncRead { address: 126, length: 10, ids: vec![1, 2, 3, 4, 5, 6] };
    assert_eq!(ask(&mut chain, BROADCAST_ID, read(), 0.5).len(), 6);
    chain.advance(1.0, 0.01, &[ServoState::default(); 6]);
    assert_eq!(ids(&ask(&mut chain, BROADCAST_ID, read(), 1.1)), [1, 2]);
}

#[test]
fn overloaded_servo_raises_the_alert_bit() {
    let mut chain = chain(&["overload=2@1"]);
    chain.advance(1.0, 0.01, &[ServoState::default(); 6]);
    let statuses = ask(&mut chain, BROADCAST_ID, Instruction::Ping, 1.1);
    let alerts: Vec<u8> = statuses.iter().filter(|status| status.alert).map(|status| status.id).collect();
    assert_eq!(alerts, [2]);
}

/// The last answer arrives at the calculated time.
#[test]
fn line_time() {
    let mut chain = chain(&[]);
    let request = Instruction::SyncRead { address: 126, length: 10, ids: vec![1, 2, 3, 4, 5, 6] };
    let wire = request.encode(BROADCAST_ID).expect("fits");
    let mut decoder = Decoder::default();
    decoder.push(&wire);
    let packet = decoder.next_packet().expect("whole").expect("good");
    let answers = chain.handle(&packet, wire.len(), BAUD, 0.0);
    let line = LineTiming { usb_latency: 0.0, ..LineTiming::default() };
    let expected = line.answers(wire.len(), &[21; 6]);
    assert!((answers[5].arrival - expected).abs() < 1e-12);
}

/// Random faults occur about as often as requested, and in the same way with the same seed.
#[test]
fn chances() {
    let count = |faults: &[&str]| {
        let mut chain = chain(faults);
        (0..1000).map(|n| ask(&mut chain, 1, Instruction::Ping, f64::from(n)).len()).sum::<usize>()
    };
    assert_eq!(count(&[]), 1000);
    assert_eq!(count(&["noise=1"]), 1000);
    let dropped = count(&["drop=0.1"]);
    assert!((870..930).contains(&dropped), "{dropped}");
    assert_eq!(dropped, count(&["drop=0.1"]));
    assert!((870..930).contains(&count(&["corrupt=0.1"])));
}

fn status(id: u8, data: &[u8]) -> Status {
    Status { id, alert: false, error: None, data: data.to_vec() }
}

/// The e-Manual's bulk read: voltage of one servo, temperature of another, in the order asked.
#[test]
fn bulk_read() {
    let mut chain = chain(&[]);
    let reads = vec![BulkRead { id: 4, address: 144, length: 2 }, BulkRead { id: 2, address: 146, length: 1 }];
    assert_eq!(
        ask(&mut chain, BROADCAST_ID, Instruction::BulkRead(reads), 0.0),
        [status(4, &[111, 0]), status(2, &[28])]
    );
}

/// A missing servo silences those after it; one that refuses answers with the error, and the next one answers.
#[test]
fn bulk_read_with_trouble() {
    let mut chain = chain(&["unplug=3@1"]);
    chain.advance(1.0, 0.01, &[ServoState::default(); 6]);
    let reads = [(1, 250, 10), (2, 0, 2), (3, 0, 2), (4, 0, 2)];
    let reads = reads.map(|(id, address, length)| BulkRead { id, address, length }).to_vec();
    let statuses = ask(&mut chain, BROADCAST_ID, Instruction::BulkRead(reads), 1.1);
    assert_eq!(ids(&statuses), [1, 2]);
    assert_eq!(
        (statuses[0].error, &statuses[1].data[..]),
        (Some(ServoError::Access), &xc330::MODEL.number.to_le_bytes()[..])
    );
}

/// One packet: `error | id | data | crc` of each servo, whose lengths differ.
#[test]
fn fast_bulk_read() {
    let mut chain = chain(&[]);
    let reads = vec![BulkRead { id: 4, address: 144, length: 2 }, BulkRead { id: 2, address: 146, length: 1 }];
    let wire = Instruction::FastBulkRead(reads).encode(BROADCAST_ID).expect("fits");
    let mut decoder = Decoder::default();
    decoder.push(&wire);
    let packet = decoder.next_packet().expect("whole").expect("good");
    let answers = chain.handle(&packet, wire.len(), BAUD, 0.0);
    assert_eq!(answers.len(), 1);
    let bytes = &answers[0].bytes;
    assert_eq!((bytes.len(), bytes[5], bytes[7]), (8 + 6 + 5, 12, 0x55));
    assert_eq!((&bytes[8..12], &bytes[14..17]), (&[0, 4, 111, 0][..], &[0, 2, 28][..]));
    for end in [12, 17] {
        assert_eq!(bytes[end..end + 2], dynamixel_bus::protocol2::crc::crc16(&bytes[..end]).to_le_bytes());
    }
}

/// Each servo gets its own registers; none answers, and a refused write is lost without affecting the others.
#[test]
fn bulk_write() {
    let mut chain = chain(&[]);
    let writes = [(1, 102, vec![60, 0]), (2, 150, vec![1]), (3, 116, vec![10, 0, 0, 0])];
    let writes = writes.map(|(id, address, data)| BulkWrite { id, address, data }).to_vec();
    assert_eq!(ask(&mut chain, BROADCAST_ID, Instruction::BulkWrite(writes), 0.0), []);
    let read = |chain: &mut ServoChain, id, address, length| {
        ask(chain, id, Instruction::Read { address, length }, 0.0).remove(0).data
    };
    assert_eq!(read(&mut chain, 1, 102, 2), [60, 0]);
    assert_eq!(read(&mut chain, 3, 116, 4), [10, 0, 0, 0]);
}

/// Two servos get their writes one after the other and execute them at once.
#[test]
fn registered_writes() {
    let mut chain = chain(&[]);
    for id in [1, 2] {
        let write = Instruction::RegWrite { address: 102, data: vec![60 + id, 0] };
        assert_eq!(ask(&mut chain, id, write, 0.0), [status(id, &[])]);
    }
    let read = |chain: &mut ServoChain, address, length| {
        let reads = uniform_reads(&[1, 2], address, length);
        ask(chain, BROADCAST_ID, Instruction::BulkRead(reads), 0.0).into_iter().map(|status| status.data[0])
    };
    assert!(read(&mut chain, 69, 1).eq([1, 1]));
    assert!(read(&mut chain, 102, 2).all(|low| low > 62));
    assert_eq!(ask(&mut chain, BROADCAST_ID, Instruction::Action, 0.0), []);
    assert!(read(&mut chain, 102, 2).eq([61, 62]));
    assert!(read(&mut chain, 69, 1).eq([0, 0]));
}

proptest! {
    /// No packet makes the servos panic, and their answers are valid packets.
    #[test]
    fn any_packet(
        instructions in prop::collection::vec(
            (
                prop::sample::select(&[1, 2, 3, 4, 5, 8, 0x10, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A][..]),
                prop_oneof![Just(BROADCAST_ID), 1..=7_u8, any::<u8>()],
                prop_oneof![prop::collection::vec(any::<u8>(), 0..40), prop::collection::vec(0..8_u8, 0..24)],
            ),
            1..12,
        ),
    ) {
        let mut chain = chain(&[]);
        for (n, (instruction, id, parameters)) in instructions.into_iter().enumerate() {
            let packet = Packet { id, instruction, parameters };
            let answers = chain.handle(&packet, 20, BAUD, n as f64);
            chain.advance(n as f64, 0.01, &[ServoState::default(); 6]);
            if matches!(instruction, 0x8A | 0x9A) {
                continue;
            }
            for answer in answers {
                let mut decoder = Decoder::default();
                decoder.push(&answer.bytes);
                let packet = decoder.next_packet().expect("whole").expect("good");
                prop_assert!(Status::decode(&packet).is_some());
            }
        }
    }
}
