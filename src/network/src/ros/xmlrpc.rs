//! Encodes and decodes XML-RPC calls and answers.

use quick_xml::escape::{escape, resolve_predefined_entity};
use quick_xml::events::{BytesRef, Event};
use quick_xml::reader::Reader;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Deepest nesting of elements.
const MAX_DEPTH: usize = 32;

/// A value of a call or an answer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum XmlRpcValue {
    Int(i32),
    Bool(bool),
    Double(f64),
    Text(String),
    List(Vec<XmlRpcValue>),
    Table(BTreeMap<String, XmlRpcValue>),
}

impl From<&str> for XmlRpcValue {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<i32> for XmlRpcValue {
    fn from(number: i32) -> Self {
        Self::Int(number)
    }
}

impl XmlRpcValue {
    pub(super) fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    pub(super) fn list(&self) -> Option<&[Self]> {
        if let Self::List(list) = self { Some(list) } else { None }
    }

    pub(super) fn int(&self) -> Option<i32> {
        if let Self::Int(number) = self { Some(*number) } else { None }
    }

    fn write(&self, out: &mut String) {
        out.push_str("<value>");
        // Writing to a text cannot fail.
        let _ = match self {
            Self::Int(number) => write!(out, "<int>{number}</int>"),
            Self::Bool(is_so) => write!(out, "<boolean>{}</boolean>", u8::from(*is_so)),
            Self::Double(number) => write!(out, "<double>{number}</double>"),
            Self::Text(text) => write!(out, "<string>{}</string>", escape(text.as_str())),
            Self::List(list) => {
                out.push_str("<array><data>");
                list.iter().for_each(|value| value.write(out));
                out.write_str("</data></array>")
            }
            Self::Table(members) => {
                out.push_str("<struct>");
                for (name, value) in members {
                    let _ = write!(out, "<member><name>{}</name>", escape(name.as_str()));
                    value.write(out);
                    out.push_str("</member>");
                }
                out.write_str("</struct>")
            }
        };
        out.push_str("</value>");
    }
}

const DECLARATION: &str = "<?xml version=\"1.0\"?>\n";

pub(super) fn write_call(method: &str, arguments: &[XmlRpcValue]) -> String {
    let mut out = format!("{DECLARATION}<methodCall><methodName>{}</methodName><params>", escape(method));
    for argument in arguments {
        out.push_str("<param>");
        argument.write(&mut out);
        out.push_str("</param>");
    }
    out.push_str("</params></methodCall>");
    out
}

pub(super) fn write_answer(answer: &XmlRpcValue) -> String {
    let mut out = format!("{DECLARATION}<methodResponse><params><param>");
    answer.write(&mut out);
    out.push_str("</param></params></methodResponse>");
    out
}

pub(super) fn write_fault(why: &str) -> String {
    let mut out = format!("{DECLARATION}<methodResponse><fault>");
    let members = [("faultCode", XmlRpcValue::Int(1)), ("faultString", XmlRpcValue::from(why))];
    XmlRpcValue::Table(members.map(|(name, value)| (name.to_owned(), value)).into()).write(&mut out);
    out.push_str("</fault></methodResponse>");
    out
}

/// Parses the method and the arguments of a call.
///
/// # Errors
/// The reason, when it is malformed.
pub(super) fn read_call(bytes: &[u8]) -> Result<(String, Vec<XmlRpcValue>), String> {
    let root = Element::root(bytes, "methodCall")?;
    let method = root.child("methodName")?.text.trim().to_owned();
    let arguments = match root.child("params") {
        Ok(params) => params.children.iter().map(|param| param.child("value")?.value()).collect(),
        Err(_) => Ok(Vec::new()),
    };
    Ok((method, arguments?))
}

/// Parses the value of an answer.
///
/// # Errors
/// The reason, when it is malformed or a fault.
pub(super) fn read_answer(bytes: &[u8]) -> Result<XmlRpcValue, String> {
    let root = Element::root(bytes, "methodResponse")?;
    if let Ok(fault) = root.child("fault") {
        let fault = fault.child("value")?.value()?;
        return Err(match &fault {
            XmlRpcValue::Table(members) => match members.get("faultString") {
                Some(XmlRpcValue::Text(why)) => why.clone(),
                _ => "a fault without a reason".to_owned(),
            },
            _ => "a fault without a reason".to_owned(),
        });
    }
    root.child("params")?.child("param")?.child("value")?.value()
}

/// An XML element without its attributes.
#[derive(Debug, Default)]
struct Element {
    name: String,
    text: String,
    children: Vec<Element>,
}

impl Element {
    fn root(bytes: &[u8], name: &str) -> Result<Self, String> {
        let text = std::str::from_utf8(bytes).map_err(|_| "not UTF-8")?;
        let mut reader = Reader::from_str(text);
        reader.config_mut().expand_empty_elements = true;
        let mut open = vec![Self::default()];
        loop {
            let event = reader.read_event().map_err(|error| error.to_string())?;
            let deep = open.len();
            let top = open.last_mut().ok_or("an end tag without a start tag")?;
            match event {
                Event::Start(start) if deep <= MAX_DEPTH => {
                    let name = String::from_utf8_lossy(start.name().as_ref()).into_owned();
                    open.push(Self { name, ..Self::default() });
                }
                Event::Start(_) => return Err(format!("elements more than {MAX_DEPTH} deep")),
                Event::End(_) => {
                    let done = open.pop().ok_or("an end tag without a start tag")?;
                    open.last_mut().ok_or("an end tag without a start tag")?.children.push(done);
                }
                Event::Text(text) => top.text += &text.decode().map_err(|error| error.to_string())?,
                Event::CData(text) => top.text += &text.decode().map_err(|error| error.to_string())?,
                Event::GeneralRef(entity) => top.text += &resolve(&entity)?,
                Event::Eof => break,
                _ => {}
            }
        }
        if open.len() != 1 {
            return Err("it ends early".to_owned());
        }
        let mut roots = open.remove(0).children;
        match roots.pop() {
            Some(root) if root.name == name && roots.is_empty() => Ok(root),
            _ => Err(format!("<{name}> is missing")),
        }
    }

    fn child(&self, name: &str) -> Result<&Self, String> {
        let found = self.children.iter().find(|child| child.name == name);
        found.ok_or_else(|| format!("<{}> without <{name}>", self.name))
    }

    /// Parses a `<value>`.
    fn value(&self) -> Result<XmlRpcValue, String> {
        let Some(inner) = self.children.first() else { return Ok(XmlRpcValue::Text(self.text.clone())) };
        let text = inner.text.trim();
        let wrong = || format!("<{}>: {text:?} is not a value of this type", inner.name);
        match inner.name.as_str() {
            "i4" | "int" => text.parse().map(XmlRpcValue::Int).map_err(|_| wrong()),
            "double" => text.parse().map(XmlRpcValue::Double).map_err(|_| wrong()),
            "boolean" => match text {
                "0" => Ok(XmlRpcValue::Bool(false)),
                "1" => Ok(XmlRpcValue::Bool(true)),
                _ => Err(wrong()),
            },
            "string" => Ok(XmlRpcValue::Text(inner.text.clone())),
            "array" => {
                let values = inner.child("data")?.children.iter().map(Self::value);
                values.collect::<Result<_, _>>().map(XmlRpcValue::List)
            }
            "struct" => {
                let members = inner
                    .children
                    .iter()
                    .map(|member| Ok((member.child("name")?.text.clone(), member.child("value")?.value()?)));
                members.collect::<Result<_, String>>().map(XmlRpcValue::Table)
            }
            name => Err(format!("<{name}> is not supported")),
        }
    }
}

/// Resolves a character or predefined entity.
fn resolve(entity: &BytesRef<'_>) -> Result<String, String> {
    if let Some(char) = entity.resolve_char_ref().map_err(|error| error.to_string())? {
        return Ok(char.to_string());
    }
    let name = entity.decode().map_err(|error| error.to_string())?;
    resolve_predefined_entity(&name).map(str::to_owned).ok_or_else(|| format!("&{name}; is not known"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn calls_and_answers_come_back_as_they_were() {
        let arguments = vec![
            XmlRpcValue::from("/a & <b>"),
            XmlRpcValue::Int(-3),
            XmlRpcValue::Bool(true),
            XmlRpcValue::Double(2.5),
            XmlRpcValue::List(vec![
                XmlRpcValue::List(vec![XmlRpcValue::from("TCPROS"), XmlRpcValue::from("")]),
                XmlRpcValue::List(vec![]),
            ]),
        ];
        let call = write_call("requestTopic", &arguments);
        assert_eq!(read_call(call.as_bytes()), Ok(("requestTopic".to_owned(), arguments.clone())));
        let answer = XmlRpcValue::List(arguments);
        assert_eq!(read_answer(write_answer(&answer).as_bytes()), Ok(answer));
        assert_eq!(
            read_answer(write_fault("no <such> method").as_bytes()),
            Err("no <such> method".to_owned())
        );
    }

    #[test]
    fn the_text_of_other_writers_is_read() {
        let text = b"<?xml version='1.0'?>\r\n<methodResponse>\n <params><param>\n<value><array><data>\n<value><i4> 1 \
            </i4></value><value>bare &#65;&amp;</value><value><string/></value><value><nothing/></value>\
            </data></array></value></param></params></methodResponse>";
        assert_eq!(read_answer(text), Err("<nothing> is not supported".to_owned()));
        let text = String::from_utf8_lossy(text).replace("<value><nothing/></value>", "");
        let list = vec![XmlRpcValue::Int(1), XmlRpcValue::from("bare A&"), XmlRpcValue::from("")];
        assert_eq!(read_answer(text.as_bytes()), Ok(XmlRpcValue::List(list)));
    }

    #[test]
    fn what_is_too_deep_or_torn_is_refused() {
        let deep = "<methodCall>".to_owned() + &"<a>".repeat(100_000);
        assert!(read_call(deep.as_bytes()).unwrap_err().contains("deep"));
        for text in ["", "<methodCall>", "</methodCall>", "<methodCall/>", "\u{0}", "<methodCall></value>"] {
            assert!(read_call(text.as_bytes()).is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn no_text_is_too_strange(text in "(<(/?)(methodCall|methodName|params|param|value|array|data|i4|a)(/?)>|[a-z0-9&;# ]{0,5}){0,40}") {
            // Any input is decoded or refused, without a panic.
            let _ = read_call(text.as_bytes());
            let _ = read_answer(text.as_bytes());
        }
    }
}
