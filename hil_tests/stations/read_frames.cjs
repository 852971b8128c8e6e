// Reads frames of MAVLink 2, a line of hexadecimal digits each, with node-mavlink; prints a line of
// JSON for each: name and fields, or null for a message that its dialects have not.
const { MavLinkProtocolV2 } = require('node-mavlink')
const { x25crc, minimal, common, standard, ardupilotmega, development } = require('mavlink-mappings')

const registry = {
  ...minimal.REGISTRY, ...common.REGISTRY, ...standard.REGISTRY, ...ardupilotmega.REGISTRY,
  ...development.REGISTRY,
}
const protocol = new MavLinkProtocolV2()
const plain = (value) => {
  if (typeof value === 'bigint') return Number(value)
  if (typeof value === 'number' && !Number.isFinite(value)) return String(value)
  return Array.isArray(value) ? value.map(plain) : value
}
for (const line of require('fs').readFileSync(0, 'ascii').split('\n').filter(Boolean)) {
  const frame = Buffer.from(line, 'hex')
  const header = protocol.header(frame)
  const kind = registry[header.msgid]
  if (!kind) {
    console.log('null')
    continue
  }
  if (x25crc(frame, 1, 2, kind.MAGIC_NUMBER) !== protocol.crc(frame)) throw new Error(kind.MSG_NAME)
  const message = protocol.data(protocol.payload(frame), kind)
  const fields = kind.FIELDS.map((field) => [field.source, plain(message[field.name])])
  console.log(JSON.stringify([kind.MSG_NAME, Object.fromEntries(fields)]))
}
