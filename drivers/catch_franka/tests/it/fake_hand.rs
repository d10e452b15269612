//! A hand that only tells its states: the Franka Hand's protocol, version 3.

use std::{
    io::{Read, Write},
    net::{TcpListener, TcpStream, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

/// Until it is dropped the hand is connected; until it is silenced it tells states.
pub struct FakeHand {
    pub address: String,
    is_silent: Arc<AtomicBool>,
    is_gone: Arc<AtomicBool>,
}

impl FakeHand {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let hand = Self { address, is_silent: Arc::default(), is_gone: Arc::default() };
        let (is_silent, is_gone) = (hand.is_silent.clone(), hand.is_gone.clone());
        thread::spawn(move || {
            let (mut client, _) = listener.accept().unwrap();
            let to = connected(&mut client);
            let states = UdpSocket::bind("127.0.0.1:0").unwrap();
            for number in 1_u32.. {
                if is_gone.load(Ordering::Relaxed) {
                    return;
                }
                if !is_silent.load(Ordering::Relaxed) {
                    // Number, width, largest width, not grasped, 30 °C.
                    let numbers = [0.08_f64, 0.08].map(f64::to_le_bytes).concat();
                    let state = [number.to_le_bytes().to_vec(), numbers, vec![0, 30, 0]].concat();
                    states.send_to(&state, ("127.0.0.1", to)).unwrap();
                }
                thread::sleep(Duration::from_millis(10));
            }
        });
        hand
    }

    pub fn silence(&self) {
        self.is_silent.store(true, Ordering::Relaxed);
    }
}

impl Drop for FakeHand {
    fn drop(&mut self) {
        self.is_gone.store(true, Ordering::Relaxed);
    }
}

/// Answers the request for a connection, and returns the port for states.
fn connected(client: &mut TcpStream) -> u16 {
    // Command, its number, size; version and port.
    let mut request = [0; 14];
    client.read_exact(&mut request).unwrap();
    let answer = [&request[..10], &0_u16.to_le_bytes(), &request[10..12]].concat();
    client.write_all(&answer).unwrap();
    u16::from_le_bytes([request[12], request[13]])
}
