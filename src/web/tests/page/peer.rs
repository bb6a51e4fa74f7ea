//! A city with a page, and pages that are connected to it.

use city3d_network::listener::Patience;
use city3d_session::served::{ServeOptions, ServedCity};
use city3d_session::{Host, LocalCity, Session, SessionHandle, Source, Token};
use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use city3d_web::{PATIENCE, PageOrders, WebOptions, WebServer};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message as Packet};
use tokio_tungstenite::{WebSocketStream, client_async};

pub const LONG: Duration = Duration::from_secs(20);

pub struct City {
    pub web: WebServer,
    pub token: String,
    pub session: SessionHandle,
}

/// The roundabout with its control framework, and a page of it.
pub fn city() -> City {
    city_with("roundabout", PATIENCE)
}

/// Any scenario, with a patience of the page's server.
pub fn city_with(scenario: &str, patience: Patience) -> City {
    let experiment = load(scenario);
    let city = LocalCity::new(Arc::clone(&experiment), Host::system()).unwrap();
    paged(city, experiment, patience)
}

/// The roundabout, served without a control framework to this many guests.
pub fn served_city(guests: usize) -> City {
    let experiment = load("roundabout");
    let options = ServeOptions { guests, ..ServeOptions::at("127.0.0.1:0") };
    let city = ServedCity::open(options, Experiment::clone(&experiment), None, Host::system()).unwrap();
    paged(city, experiment, PATIENCE)
}

fn load(scenario: &str) -> Arc<Experiment> {
    let request = ScenarioRequest { scenario: scenario.to_owned(), ..ScenarioRequest::default() };
    city3d_session::load(&request).unwrap()
}

fn paged(city: impl Source + 'static, experiment: Arc<Experiment>, patience: Patience) -> City {
    let session = Session::new(city, Host::system());
    let token = Token::draw().unwrap();
    let text = token.text().to_owned();
    let orders = PageOrders::City(session.orders().unwrap());
    let address = "127.0.0.1:0".to_owned();
    let options = WebOptions::new(address, token, experiment, orders);
    let web = WebServer::start(WebOptions { patience, ..options }).unwrap();
    let session = session.with_end(Box::new(web.end())).spawn(None).unwrap();
    web.watch(session.published());
    City { web, token: text, session }
}

pub struct Page(pub WebSocketStream<TcpStream>);

pub async fn open(address: SocketAddr, origin: &str) -> Result<Page, Error> {
    open_on(TcpStream::connect(address).await.unwrap(), address, origin).await
}

async fn open_on(stream: TcpStream, address: SocketAddr, origin: &str) -> Result<Page, Error> {
    let mut request = format!("ws://{address}/socket").into_client_request().unwrap();
    request.headers_mut().insert("Origin", origin.parse().unwrap());
    Ok(Page(client_async(request, stream).await?.0))
}

impl Page {
    pub async fn new(address: SocketAddr, token: Option<&str>) -> Self {
        Self::on(TcpStream::connect(address).await.unwrap(), address, token).await
    }

    /// A page on a connection.
    pub async fn on(stream: TcpStream, address: SocketAddr, token: Option<&str>) -> Self {
        let mut page = open_on(stream, address, &format!("http://{address}")).await.unwrap();
        page.send(json!({ "t": "hello", "token": token })).await;
        page
    }

    pub async fn send(&mut self, message: Value) {
        self.0.send(Packet::text(message.to_string())).await.unwrap();
    }

    /// The next message that this is true of.
    pub async fn hear(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        let look = async {
            loop {
                if let Packet::Text(text) = self.0.next().await.unwrap().unwrap() {
                    let message = serde_json::from_str(&text).unwrap();
                    if wanted(&message) {
                        return message;
                    }
                }
            }
        };
        timeout(LONG, look).await.unwrap()
    }

    pub async fn hear_of(&mut self, kind: &str) -> Value {
        self.hear(|message| message["t"] == kind).await
    }

    /// The code that the server closes with; `None` where it just ends.
    pub async fn closed(&mut self) -> Option<u16> {
        let look = async {
            loop {
                match self.0.next().await {
                    Some(Ok(Packet::Close(frame))) => return frame.map(|frame| frame.code.into()),
                    Some(Ok(_)) => {}
                    Some(Err(_)) | None => return None,
                }
            }
        };
        timeout(LONG, look).await.unwrap()
    }
}

pub async fn asked(address: SocketAddr, head: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut answer = String::new();
    timeout(LONG, stream.read_to_string(&mut answer)).await.unwrap().unwrap();
    answer
}
