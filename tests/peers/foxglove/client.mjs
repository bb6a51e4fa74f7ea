// Foxglove's own client of its WebSocket protocol, and its readers of ROS 2 messages, on a city that runs.
//
//   node client.mjs URL    connects with the address with the token, reads what is published, calls services and sets
//                          parameters; prints one line a finding; fails where something is not as it should be
import protocol from "@foxglove/ws-protocol";
import rosmsg from "@foxglove/rosmsg";
import ros2 from "@foxglove/rosmsg2-serialization";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";
import WebSocket from "ws";

const TIMEOUT_MS = 30000;
const url = process.argv[2];

function check(is_so, what) {
  if (!is_so) throw new Error(what);
}

function pause(ms) {
  return new Promise((resolve) => setTimeout(resolve, ms));
}

async function until(look, what) {
  const end = Date.now() + TIMEOUT_MS;
  while (Date.now() < end) {
    const found = look();
    if (found !== undefined && found !== false) return found;
    await pause(10);
  }
  throw new Error(`not within ${TIMEOUT_MS} ms: ${what}`);
}

/** Reads messages as Foxglove does: by the definition that comes with the channel. */
function reader(channel) {
  if (channel.encoding === "json") return (data) => JSON.parse(new TextDecoder().decode(data));
  if (channel.encoding === "cdr") {
    check(channel.schemaEncoding === "ros2msg", `${channel.topic}: ${channel.schemaEncoding}`);
    const read = new ros2.MessageReader(rosmsg.parse(channel.schema, { ros2: true }));
    return (data) => read.readMessage(data);
  }
  check(channel.encoding === "protobuf", `${channel.topic}: ${channel.encoding}`);
  const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(Buffer.from(channel.schema, "base64")));
  const type = root.lookupType(channel.schemaName);
  return (data) => type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
}

class Peer {
  constructor(address, subprotocol = "foxglove.sdk.v1") {
    const socket = new WebSocket(address, [subprotocol]);
    this.client = new protocol.FoxgloveClient({ ws: socket });
    this.channels = new Map();
    this.services = new Map();
    this.heard = new Map();
    this.readers = new Map();
    this.answers = [];
    this.statuses = [];
    this.parameters = new Map();
    this.times = [];
    this.calls = 0;
    const { client } = this;
    client.on("error", (error) => this.statuses.push({ message: `error: ${error.message}` }));
    client.on("serverInfo", (info) => (this.info = info));
    client.on("status", (status) => this.statuses.push(status));
    client.on("advertise", (channels) => channels.forEach((it) => this.channels.set(it.topic, it)));
    client.on("advertiseServices", (services) => services.forEach((it) => this.services.set(it.name, it)));
    client.on("time", ({ timestamp }) => this.times.push(timestamp));
    client.on("parameterValues", ({ parameters }) => parameters.forEach((it) => this.parameters.set(it.name, it.value)));
    client.on("serviceCallResponse", (answer) => this.answers.push(answer));
    client.on("message", ({ subscriptionId, timestamp, data }) => {
      const { topic, read } = this.readers.get(subscriptionId);
      this.heard.get(topic).push({ timestamp, message: read(data) });
    });
  }

  async subscribe(topic) {
    const channel = await until(() => this.channels.get(topic), `the channel ${topic}`);
    this.heard.set(topic, []);
    this.readers.set(this.client.subscribe(channel.id), { topic, read: reader(channel) });
  }

  async hear(topic, count = 1, of = () => true) {
    return until(() => {
      const found = this.heard.get(topic).filter(({ message }) => of(message));
      return found.length >= count && found;
    }, `${count} messages on ${topic}`);
  }

  async call(name, request = {}) {
    const service = await until(() => this.services.get(name), `the service ${name}`);
    const callId = ++this.calls;
    const data = new DataView(new TextEncoder().encode(JSON.stringify(request)).buffer);
    this.client.sendServiceCallRequest({ serviceId: service.id, callId, encoding: "json", data });
    const answer = await until(() => this.answers.find((it) => it.callId === callId), `an answer of ${name}`);
    return JSON.parse(new TextDecoder().decode(answer.data));
  }

  async parameter(name, value) {
    return until(() => this.parameters.get(name) === value, `${name} is ${value}, not ${this.parameters.get(name)}`);
  }
}

async function talk() {
  const peer = new Peer(url);
  await until(() => peer.info, "the server's info");
  check(peer.info.capabilities.includes("services"), JSON.stringify(peer.info));
  const log = ["/city3d/snapshot", "/city3d/event", "/city3d/tick", "/city3d/network"];
  for (const topic of [...log, "/city3d/scene", "/city3d/map", "/tf", "/city3d/metrics"]) await peer.subscribe(topic);
  peer.client.subscribeParameterUpdates(["/city3d/state", "/city3d/speed"]);
  const snapshots = await peer.hear("/city3d/snapshot", 50, (it) => it.vehicles.length === 6);
  const name = [...peer.channels.keys()].map((it) => it.split("/")).find((it) => it[1] === "vicon")[2];
  await peer.subscribe(`/vicon/${name}/${name}`);
  const [{ message: pose }] = await peer.hear(`/vicon/${name}/${name}`);
  check(pose.header.frame_id === "/vicon/world", pose.header.frame_id);
  console.log(`the log's own messages: ${log.join(", ")} and the poses of ${name} are read by @foxglove/rosmsg2-serialization`);
  const last = snapshots.at(-1).message;
  const [{ message: scene }] = await peer.hear("/city3d/scene", 1, (it) => it.entities.length >= 6);
  const at = scene.entities.find((it) => it.id === name).cubes[0].pose.position;
  const own = pose.transform.translation;
  check(Math.hypot(at.x - 25 * own.x, at.y - 25 * own.y) < 15, `${name} is at ${at.x}, ${at.y}`);
  const [{ message: map }] = await peer.hear("/city3d/map");
  check(map.entities[0].triangles.length > 20, "the roads have their lanes");
  const [{ message: moves }] = await peer.hear("/tf", 1, (it) => it.transforms.length >= 6);
  check(moves.transforms.every((it) => it.parentFrameId === "city"), "all frames are in the city");
  const [{ message: metrics }] = await peer.hear("/city3d/metrics", 1, (it) => it.phase === "running");
  check(metrics.vehicles === 6 && metrics.leader, JSON.stringify(metrics));
  console.log(`scene, roads, transforms and metrics are read by their own definitions; tick ${last.tick}`);

  const refused = await peer.call("/city3d/set_speed", { factor: 2 });
  check(!refused.success && refused.message.length > 10, JSON.stringify(refused));
  console.log(`set_speed of a served city: ${refused.message}`);
  check((await peer.call("/city3d/pause")).success, "pause");
  await peer.parameter("/city3d/state", "paused");
  peer.client.setParameters([{ name: "/city3d/state", value: "running" }], "set");
  await peer.parameter("/city3d/state", "running");
  const before = peer.times.at(-1);
  check((await peer.call("/city3d/reset")).success, "reset");
  await until(() => peer.times.at(-1) < before, "the time goes back");
  console.log("pause, start and reset are carried out, as services and as parameters; the time goes back with a reset");

  // As older applications call it.
  const watcher = new Peer(url.split("?")[0], protocol.FoxgloveClient.SUPPORTED_SUBPROTOCOL);
  const answer = await watcher.call("/city3d/start");
  check(!answer.success && answer.message.includes("watches"), JSON.stringify(answer));
  await watcher.subscribe("/city3d/snapshot");
  await watcher.hear("/city3d/snapshot");
  console.log("without the token one watches");
  check(peer.statuses.every((it) => !it.message.startsWith("error")), JSON.stringify(peer.statuses));
  peer.client.close();
  watcher.client.close();
}

talk().catch((error) => {
  console.error(`error: ${error.message}`);
  process.exit(1);
});
