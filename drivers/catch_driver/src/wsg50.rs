//! The WSG-50 over TCP, by the command set that its maker publishes.
//!
//! A packet is three bytes 0xAA, the command's number, the size of the payload, the payload, and a checksum.
//! Answers begin with a status; a motion is answered twice: as it begins, and when it has ended. Fingers are
//! positioned with
//! *clamp on block*, so that a grasp of any width is one command, and the next position needs no release.

use std::{
    io::{self, Read, Write},
    net::{TcpStream, ToSocketAddrs},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    time::Duration,
};

use catch_cell::GripperMove;

use crate::hand::{Fingers, is_grasp};

/// Port of the command interface where the address names none.
const PORT: u16 = 1000;
/// Longest wait for a packet while the fingers may be homed, and for a motion's end.
const HOMING: Duration = Duration::from_secs(10);
/// Longest wait for a state.
const SILENCE: Duration = Duration::from_secs(1);
/// Interval of the states in ms.
const INTERVAL_MS: u16 = 10;
/// Bytes of a packet before its payload, and the most that a payload has here.
const HEADER: usize = 6;
const LONGEST: usize = 256;

/// Numbers of commands.
const HOME: u8 = 0x20;
const POSITION: u8 = 0x21;
const ACKNOWLEDGE: u8 = 0x24;
const FORCE_LIMIT: u8 = 0x32;
const SYSTEM_STATE: u8 = 0x40;
const WIDTH: u8 = 0x43;
/// Statuses of answers.
const SUCCESS: u16 = 0;
const PENDING: u16 = 26;
const AXIS_BLOCKED: u16 = 29;
/// Bit of the system state: the fingers are homed.
const REFERENCED: u8 = 1;

/// Checksum of the command set's manual: its table is that of the polynomial 0x1021, the highest bit first,
/// and its register is shifted to the right.
fn checksum(bytes: &[u8]) -> u16 {
    let entry =
        |index: u16| (0..8).fold(index << 8, |it, _| if it & 0x8000 == 0 { it << 1 } else { (it << 1) ^ 0x1021 });
    bytes.iter().fold(0xFFFF, |crc, byte| entry((crc ^ u16::from(*byte)) & 0xFF) ^ (crc >> 8))
}

/// A packet.
pub fn packet(command: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = [&[0xAA, 0xAA, 0xAA, command], &(payload.len() as u16).to_le_bytes()[..], payload].concat();
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// Reads a packet: the command's number and the payload.
///
/// # Errors
/// A connection that is lost, or says something else.
pub fn read_packet(input: &mut impl Read) -> io::Result<(u8, Vec<u8>)> {
    let invalid = |cause: &str| io::Error::new(io::ErrorKind::InvalidData, format!("no packet of a WSG: {cause}"));
    let mut bytes = vec![0; HEADER];
    input.read_exact(&mut bytes)?;
    let size = usize::from(u16::from_le_bytes([bytes[4], bytes[5]]));
    if bytes[..3] != [0xAA; 3] || size > LONGEST {
        return Err(invalid("found another beginning than AA AA AA and a size"));
    }
    bytes.resize(HEADER + size + 2, 0);
    input.read_exact(&mut bytes[HEADER..])?;
    // The checksum of a packet with its checksum is zero.
    if checksum(&bytes) != 0 {
        return Err(invalid("the checksum is wrong"));
    }
    Ok((bytes[3], bytes[HEADER..HEADER + size].to_vec()))
}

/// The status of an answer, and what follows it.
fn answered(payload: &[u8]) -> (u16, &[u8]) {
    payload.split_first_chunk().map_or((PENDING, payload), |(status, rest)| (u16::from_le_bytes(*status), rest))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Wsg50 {
    input: Mutex<TcpStream>,
    output: Mutex<TcpStream>,
    /// Statuses with which commands ended, from whoever reads the states.
    ended: Sender<(u8, u16)>,
    ends: Mutex<Receiver<(u8, u16)>>,
    force_n: Mutex<f64>,
    is_held: AtomicBool,
}

/// Connects, homes fingers that are not homed, and asks for states.
///
/// # Errors
/// If the hand does not answer, or cannot be homed.
pub fn connect(address: &str) -> Result<Arc<dyn Fingers>, String> {
    connected(address).map(|it| Arc::new(it) as Arc<dyn Fingers>).map_err(|fault| format!("{address}: {fault}"))
}

fn connected(address: &str) -> io::Result<Wsg50> {
    let with_port = if address.contains(':') { address.to_owned() } else { format!("{address}:{PORT}") };
    let place = with_port.to_socket_addrs()?.next().ok_or(io::ErrorKind::NotFound)?;
    let mut stream = TcpStream::connect_timeout(&place, SILENCE)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(HOMING))?;
    // A connection that was lost before has left a fast stop behind. Where there is none, that is no fault.
    asked(&mut stream, ACKNOWLEDGE, b"ack")?;
    let (_, state) = asked(&mut stream, SYSTEM_STATE, &[0; 3])?;
    if state.first().is_none_or(|it| it & REFERENCED == 0) {
        let (status, _) = asked(&mut stream, HOME, &[0])?;
        if status != SUCCESS {
            return Err(io::Error::other(format!("the fingers cannot be homed: status {status}")));
        }
    }
    let [low, high] = INTERVAL_MS.to_le_bytes();
    asked(&mut stream, WIDTH, &[1, low, high])?;
    stream.set_read_timeout(Some(SILENCE))?;
    let (ended, ends) = channel();
    Ok(Wsg50 {
        input: Mutex::new(stream.try_clone()?),
        output: Mutex::new(stream),
        ended,
        ends: Mutex::new(ends),
        force_n: Mutex::new(f64::NAN),
        is_held: AtomicBool::new(false),
    })
}

/// Gives a command before there are states, and waits for its end.
fn asked(stream: &mut TcpStream, command: u8, payload: &[u8]) -> io::Result<(u16, Vec<u8>)> {
    stream.write_all(&packet(command, payload))?;
    loop {
        let (number, answer) = read_packet(stream)?;
        let (status, rest) = answered(&answer);
        if number == command && status != PENDING {
            return Ok((status, rest.to_vec()));
        }
    }
}

impl Wsg50 {
    /// Gives a command, and waits for the status with which it ends.
    fn done(&self, command: u8, payload: &[u8]) -> Result<u16, String> {
        lock(&self.output).write_all(&packet(command, payload)).map_err(|fault| fault.to_string())?;
        let ends = lock(&self.ends);
        loop {
            match ends.recv_timeout(HOMING) {
                Ok((number, status)) if number == command => return Ok(status),
                Ok(_) => {}
                Err(_) => return Err(format!("no answer to the command {command:#04x}")),
            }
        }
    }
}

impl Fingers for Wsg50 {
    fn next_state(&self) -> Result<(f64, bool), String> {
        let mut input = lock(&self.input);
        loop {
            let (number, payload) = read_packet(&mut *input).map_err(|fault| fault.to_string())?;
            match (number, answered(&payload)) {
                (WIDTH, (SUCCESS, width)) => {
                    if let Some(width_mm) = width.first_chunk() {
                        let width_m = f64::from(f32::from_le_bytes(*width_mm)) * 1e-3;
                        return Ok((width_m, self.is_held.load(Ordering::Relaxed)));
                    }
                }
                (_, (PENDING, _)) => {}
                // Nobody waits for it once the hand moves no more.
                (number, (status, _)) => drop(self.ended.send((number, status))),
            }
        }
    }

    fn execute(&self, step: &GripperMove) -> Result<(), String> {
        let mut force_n = lock(&self.force_n);
        if *force_n != step.force_n {
            self.done(FORCE_LIMIT, &(step.force_n as f32).to_le_bytes())?;
            *force_n = step.force_n;
        }
        self.is_held.store(false, Ordering::Relaxed);
        let [width, speed] = [step.width_m, step.speed_mps].map(|it| (it as f32 * 1e3).to_le_bytes());
        // To a width, and clamp on block.
        let status = self.done(POSITION, &[&[0], &width[..], &speed[..]].concat())?;
        self.is_held.store(is_grasp(step) && status == AXIS_BLOCKED, Ordering::Relaxed);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{clock::Clock, hand::Hand};
    use std::{net::TcpListener, thread, time::Instant};

    /// Packets of the manual's examples.
    #[test]
    fn packets_are_those_of_the_manual() {
        for (command, payload, expected) in [
            (0x01, &[][..], &[0xAA, 0xAA, 0xAA, 0x01, 0x00, 0x00, 0xE8, 0x10][..]),
            (0x01, &[0x12, 0x34], &[0xAA, 0xAA, 0xAA, 0x01, 0x02, 0x00, 0x12, 0x34, 0x6D, 0x66]),
            (HOME, &[0, 0], &[0xAA, 0xAA, 0xAA, 0x20, 0x02, 0x00, 0x00, 0x00, 0xB3, 0xFD]),
            (POSITION, &[26, 0], &[0xAA, 0xAA, 0xAA, 0x21, 0x02, 0x00, 0x1A, 0x00, 0x67, 0xCB]),
        ] {
            assert_eq!(packet(command, payload), expected);
            assert_eq!(read_packet(&mut &expected[..]).unwrap(), (command, payload.to_vec()));
        }
        let mut wrong = packet(POSITION, &[0, 0]);
        wrong[6] ^= 4;
        assert!(read_packet(&mut &wrong[..]).unwrap_err().to_string().contains("checksum"));
        assert!(read_packet(&mut &[0xAB; 8][..]).unwrap_err().to_string().contains("AA AA AA"));
    }

    /// What a gripper was commanded: number and payload.
    type Commands = Receiver<(u8, Vec<u8>)>;

    /// A gripper that answers as the manual's tables say, with something of 60 mm between its fingers. It
    /// moves while one answer follows another, and is homed if that was asked for.
    fn gripper(mut is_homed: bool) -> (String, Commands) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let (told, commands) = channel();
        thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut width_mm, mut states) = (110.0_f32, false);
            stream.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
            let answer = |stream: &mut TcpStream, number: u8, status: u16, rest: &[u8]| {
                stream.write_all(&packet(number, &[&status.to_le_bytes()[..], rest].concat())).is_ok()
            };
            loop {
                let mut first = [0];
                if !matches!(stream.peek(&mut first), Ok(1)) {
                    if states && !answer(&mut stream, WIDTH, SUCCESS, &width_mm.to_le_bytes()) {
                        return;
                    }
                    continue;
                }
                let (number, payload) = read_packet(&mut stream).unwrap();
                let status = match number {
                    SYSTEM_STATE => {
                        answer(&mut stream, number, SUCCESS, &[u8::from(is_homed), 0, 0, 0]);
                        continue;
                    }
                    WIDTH => {
                        states = payload[0] == 1;
                        answer(&mut stream, number, SUCCESS, &width_mm.to_le_bytes());
                        continue;
                    }
                    HOME | POSITION => {
                        answer(&mut stream, number, PENDING, &[]);
                        is_homed |= number == HOME;
                        let wanted_mm = payload.get(1..5).map(|it| f32::from_le_bytes(it.try_into().unwrap()));
                        width_mm = wanted_mm.unwrap_or(110.0).max(60.0);
                        if wanted_mm.is_some_and(|it| it < 60.0) { AXIS_BLOCKED } else { SUCCESS }
                    }
                    ACKNOWLEDGE => 18,
                    _ => SUCCESS,
                };
                answer(&mut stream, number, status, &[]);
                if told.send((number, payload)).is_err() {
                    return;
                }
            }
        });
        (address, commands)
    }

    /// Waits for a state of the hand.
    fn until(hand: &Hand, is_there: impl Fn(f64, bool) -> bool) {
        let began = Instant::now();
        while let Ok((state, _)) = hand.state() {
            if is_there(state.width_m, state.grasp == catch_cell::GraspState::Holding) {
                return;
            }
            assert!(began.elapsed() < Duration::from_secs(20), "{state:?}");
            thread::sleep(Duration::from_millis(1));
        }
        panic!("{:?}", hand.state());
    }

    #[test]
    fn fingers_are_homed_positioned_and_grasp() {
        let (address, commands) = gripper(false);
        let hand = Hand::new(connect(&address).unwrap(), Clock::Host).unwrap();
        let step = |width_m: f64, force_n: f64| GripperMove { start_s: 0.0, width_m, speed_mps: 0.4, force_n };
        hand.receive(vec![step(0.08, 40.0)]);
        until(&hand, |width_m, is_held| (width_m - 0.08).abs() < 1e-6 && !is_held);
        hand.receive(vec![step(0.0, 40.0)]);
        until(&hand, |width_m, is_held| (width_m - 0.06).abs() < 1e-6 && is_held);
        hand.receive(vec![step(0.1, 80.0)]);
        until(&hand, |width_m, is_held| (width_m - 0.1).abs() < 1e-6 && !is_held);
        let floats = |list: &[f32]| list.iter().flat_map(|it| it.to_le_bytes()).collect::<Vec<u8>>();
        let to = |width_mm: f32| (POSITION, [vec![0], floats(&[width_mm, 400.0])].concat());
        let expected = [
            (ACKNOWLEDGE, b"ack".to_vec()),
            (HOME, vec![0]),
            (FORCE_LIMIT, floats(&[40.0])),
            to(80.0),
            to(0.0),
            (FORCE_LIMIT, floats(&[80.0])),
            to(100.0),
        ];
        assert_eq!(commands.try_iter().collect::<Vec<_>>(), expected);
    }

    /// A hand that is homed moves only when it is told to; one that goes away is told, and one that is not
    /// there.
    #[test]
    fn a_lost_hand_is_told() {
        let (address, commands) = gripper(true);
        let hand = Hand::new(connect(&address).unwrap(), Clock::Host).unwrap();
        assert_eq!(commands.try_iter().map(|it| it.0).collect::<Vec<_>>(), [ACKNOWLEDGE]);
        drop(commands);
        hand.receive(vec![GripperMove { start_s: 0.0, width_m: 0.05, speed_mps: 0.4, force_n: 40.0 }]);
        let began = Instant::now();
        while hand.state().is_ok() {
            assert!(began.elapsed() < Duration::from_secs(20), "nothing is told");
            thread::sleep(Duration::from_millis(1));
        }
        assert!(connect(&address).err().unwrap().contains(&address), "nobody is there any more");
    }
}
