use session_log::{Event, Reader};
fn main() {
    let mut reader = Reader::open(std::path::Path::new(&std::env::args().nth(1).unwrap())).unwrap();
    let (mut last, mut obs) = (0.0, None);
    while let Ok(Some((_, event))) = reader.next_event() {
        match event {
            Event::Observation(o) => obs = Some(o),
            Event::Sent(sent) => {
                let o = obs.take().unwrap();
                if o.time > 400.0 && o.time > last + 1.0 {
                    last = o.time;
                    let d: Vec<String> =
                        (0..7).map(|j| format!("{:.3}/{:.3}", sent.arm[j], o.arm.position[j])).collect();
                    println!("{:.1} {}", o.time, d.join(" "));
                }
                if o.time > 640.0 {
                    break;
                }
            }
            _ => {}
        }
    }
}
