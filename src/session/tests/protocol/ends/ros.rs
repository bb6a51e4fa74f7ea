//! ROS whose master is away, comes, and goes; and a subscriber that stops reading, is gone, and comes back.

use super::{Stage, passes};
use city3d_network::link::vicon::{RosTransport, Vicon, ViconOptions};
use city3d_network::ros::NodeOptions;
use city3d_session::ros::RosNode;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// More vehicles, whose transforms fill the socket of who does not read.
const CROWD: u32 = 40;

fn node_under(master: SocketAddr) -> RosNode {
    let master = format!("http://{master}").parse().unwrap();
    let node = NodeOptions { name: "/city3d_alone".to_owned(), master, bind: None };
    let transport = RosTransport::Node(node);
    let options = ViconOptions { transport, has_clock: true, subscribed: Vec::new(), cameras: Vec::new() };
    RosNode::new(Box::new(Vicon::start(options).unwrap()), "ros", true)
}

#[test]
fn without_a_master_the_city_goes_on_and_says_so_once() {
    // The port for reserved use: nothing listens there.
    let node = node_under((Ipv4Addr::LOCALHOST, 1).into());
    let stages = vec![
        Stage::new("it is away", |health| health.failure.is_some()),
        Stage::new("it stays away", |health| health.failure.is_some()),
    ];
    let (health, accounts) = passes(Box::new(node.poses()), 0, stages);
    assert_eq!(health.failure.unwrap().to_string(), "its master or server is away");
    assert_eq!(accounts[0].failures, 1, "said once");
}

#[test]
fn a_master_and_a_subscriber_may_go_and_come_back() {
    let far = Arc::new(Far::new());
    let node = node_under(far.place);
    let act = |act: fn(&Far)| {
        let far = Arc::clone(&far);
        move |_: &_| act(&far)
    };
    let reads = |least: u64| {
        let far = Arc::clone(&far);
        move |_: &_| far.read.load(Ordering::Relaxed) >= least
    };
    let stages = vec![
        Stage::new("the master is away", |health| health.failure.is_some()).then(act(Far::start_master)),
        Stage::new("the master is there", |health| health.failure.is_none()).then(act(Far::subscribe)),
        Stage::new("somebody reads", reads(100)).then(act(Far::stop_reading)),
        Stage::new("poses are dropped for the slow one", |health| health.dropped > 200)
            .then(act(Far::leave))
            .then(act(Far::stop_master)),
        Stage::new("the master is away again", |health| health.failure.is_some())
            .then(act(Far::start_master)),
        Stage::new("the master is back", |health| health.failure.is_none()).then(act(Far::subscribe)),
        Stage::new("somebody reads again", reads(100)),
    ];
    let (health, accounts) = passes(Box::new(node.poses()), CROWD, stages);
    assert!(health.failure.is_none() && health.delivered > 500, "{health:?}");
    assert_eq!(accounts[0].failures, 2, "the master was away twice");
}

/// The far side of a node: its master, and a subscriber of `/tf`.
struct Far {
    place: SocketAddr,
    master: Mutex<Option<Master>>,
    subscriber: Mutex<Option<Subscriber>>,
    /// Messages that the present subscriber has read.
    read: Arc<AtomicU64>,
}

impl Far {
    fn new() -> Self {
        // A port that is free now, and stays so: the system gives others first.
        let place = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
        Self { place, master: Mutex::default(), subscriber: Mutex::default(), read: Arc::default() }
    }

    fn start_master(&self) {
        *self.master.lock().unwrap() = Some(Master::start(self.place));
    }

    fn stop_master(&self) {
        self.master.lock().unwrap().take().unwrap().stop();
    }

    fn subscribe(&self) {
        let master = self.master.lock().unwrap();
        let node = master.as_ref().unwrap().node.lock().unwrap().unwrap();
        self.read.store(0, Ordering::Relaxed);
        *self.subscriber.lock().unwrap() = Some(Subscriber::connect(node, Arc::clone(&self.read)));
    }

    fn stop_reading(&self) {
        let subscriber = self.subscriber.lock().unwrap();
        subscriber.as_ref().unwrap().is_slow.store(true, Ordering::Relaxed);
    }

    fn leave(&self) {
        self.subscriber.lock().unwrap().take().unwrap().leave();
    }
}

/// As much of a ROS master as one publishing node needs.
struct Master {
    place: SocketAddr,
    /// Where the node that registers answers calls.
    node: Arc<Mutex<Option<SocketAddr>>>,
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Master {
    fn start(place: SocketAddr) -> Self {
        let listener = TcpListener::bind(place).unwrap();
        let (node, is_over) = (Arc::<Mutex<_>>::default(), Arc::<AtomicBool>::default());
        let (of_thread, ends) = (Arc::clone(&node), Arc::clone(&is_over));
        let thread = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                answer(stream.unwrap(), &of_thread);
            }
        });
        Self { place, node, is_over, thread }
    }

    fn stop(self) {
        self.is_over.store(true, Ordering::Relaxed);
        drop(TcpStream::connect(self.place));
        self.thread.join().unwrap();
    }
}

/// Answers one call of the Master API.
fn answer(mut stream: TcpStream, node: &Mutex<Option<SocketAddr>>) {
    let call = read_http(&mut stream);
    let (code, value) = if call.contains("<methodName>lookupNode<") {
        (-1, "<int>0</int>")
    } else if call.contains("<methodName>register") {
        let uri = call.rsplit("http://").next().unwrap();
        let end = uri.find(['/', '<']).unwrap();
        *node.lock().unwrap() = Some(uri[..end].parse().unwrap());
        (1, "<array><data></data></array>")
    } else {
        (1, "<int>7</int>")
    };
    let body = format!(
        "<?xml version='1.0'?><methodResponse><params><param><value><array><data><value><int>{code}</int></value>\
         <value><string>done</string></value><value>{value}</value></data></array></value></param></params>\
         </methodResponse>"
    );
    let head = format!("HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n", body.len());
    // A node that ends does not wait for it.
    let _ = stream.write_all((head + &body).as_bytes());
}

/// Reads a message of HTTP with its body.
fn read_http(stream: &mut TcpStream) -> String {
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    loop {
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| {
                let (name, value) = line.split_once(':')?;
                name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse::<usize>().unwrap())
            });
            if body.len() >= length.unwrap() {
                return text;
            }
        }
        match stream.read(&mut bytes).unwrap() {
            0 => return text,
            count => text.push_str(std::str::from_utf8(&bytes[..count]).unwrap()),
        }
    }
}

/// A connection over TCPROS to the topic `/tf`.
struct Subscriber {
    is_slow: Arc<AtomicBool>,
    stream: TcpStream,
    thread: JoinHandle<()>,
}

impl Subscriber {
    fn connect(node: SocketAddr, read: Arc<AtomicU64>) -> Self {
        let mut stream = TcpStream::connect(topic_address(node)).unwrap();
        let mut header = Vec::new();
        for field in ["callerid=/far", "topic=/tf", "type=*", "md5sum=*"] {
            header.extend((field.len() as u32).to_le_bytes());
            header.extend(field.as_bytes());
        }
        stream.write_all(&(header.len() as u32).to_le_bytes()).unwrap();
        stream.write_all(&header).unwrap();
        let is_slow = Arc::<AtomicBool>::default();
        let (mut from, slow) = (stream.try_clone().unwrap(), Arc::clone(&is_slow));
        let thread = std::thread::spawn(move || {
            let greeting = read_frame(&mut from).unwrap();
            assert!(String::from_utf8_lossy(&greeting).contains("type=tf2_msgs/TFMessage"));
            while read_frame(&mut from).is_ok() {
                read.fetch_add(1, Ordering::Relaxed);
                while slow.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Self { is_slow, stream, thread }
    }

    fn leave(self) {
        self.stream.shutdown(std::net::Shutdown::Both).unwrap();
        self.is_slow.store(false, Ordering::Relaxed);
        self.thread.join().unwrap();
    }
}

/// Asks a node where it publishes `/tf`.
fn topic_address(node: SocketAddr) -> SocketAddr {
    let text = |text: &str| format!("<value><string>{text}</string></value>");
    let list = |of: &str| format!("<value><array><data>{of}</data></array></value>");
    let parameters = [text("/far"), text("/tf"), list(&list(&text("TCPROS")))];
    let parameters = parameters.map(|parameter| format!("<param>{parameter}</param>")).concat();
    let body = format!(
        "<?xml version='1.0'?><methodCall><methodName>requestTopic</methodName><params>{parameters}</params></methodCall>"
    );
    let mut stream = TcpStream::connect(node).unwrap();
    let head = format!("POST / HTTP/1.1\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n", body.len());
    stream.write_all((head + &body).as_bytes()).unwrap();
    let told = read_http(&mut stream);
    let port = told
        .split("TCPROS")
        .nth(1)
        .unwrap()
        .split(['<', '>'])
        .filter_map(|word| word.parse().ok())
        .next_back();
    SocketAddr::new(node.ip(), port.unwrap())
}

fn read_frame(from: &mut TcpStream) -> std::io::Result<Vec<u8>> {
    let mut length = [0; 4];
    from.read_exact(&mut length)?;
    let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}
