"""DBC files of random layouts, and what cantools, the oracle, reads in them."""

from dataclasses import dataclass

from hypothesis import strategies as st

from robotctl.messages.ports import FD_LENGTHS

HEAD = """VERSION ""
BU_: HOST DRIVE
"""
FORMATS = """BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG",\
"reserved","reserved","reserved","reserved","reserved","reserved","reserved","reserved",\
"reserved","reserved","StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
"""
STANDARD_FD, EXTENDED_FD = 14, 15
EXTENDED = 0x8000_0000
SCALES = [(1, 0), (1, 0), (0.5, 0), (0.001, 0), (2, 3), (-0.25, 10), (0.1, -3.5)]


@dataclass(frozen=True)
class Field:
    """A signal of a layout."""

    name: str
    start: int
    length: int
    big_endian: bool
    signed: bool
    is_float: bool
    scale: float
    offset: float

    def bits(self):
        """Bits that it takes, as the DBC numbers them."""
        if not self.big_endian:
            return range(self.start, self.start + self.length)
        taken, bit = [], self.start
        for _ in range(self.length):
            taken.append(bit)
            bit = bit - 1 if bit % 8 else bit + 15
        return taken

    def line(self):
        """Its line in the file."""
        kind = f"{0 if self.big_endian else 1}{'-' if self.signed else '+'}"
        return (
            f" SG_ {self.name} : {self.start}|{self.length}@{kind} "
            f'({self.scale!r},{self.offset!r}) [0|0] "" HOST\n'
        )


@st.composite
def layouts(draw):
    """Text of a DBC with one message, `Message`, of any identifier, length and signals."""
    extended, fd = draw(st.booleans()), draw(st.booleans())
    can_id = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    length = draw(st.sampled_from(FD_LENGTHS[1:] if fd else range(1, 9)))
    fields, taken = [], set()
    for number in range(draw(st.integers(1, 8))):
        is_float = draw(st.booleans()) and length >= 4
        size = draw(st.sampled_from([32, 64])) if is_float else draw(st.integers(1, 64))
        scale, offset = draw(st.sampled_from(SCALES))
        field = Field(
            name=f"S{number}",
            start=draw(st.integers(0, 8 * length - 1)),
            length=size,
            big_endian=draw(st.booleans()),
            signed=is_float or draw(st.booleans()),
            is_float=is_float,
            scale=scale,
            offset=offset,
        )
        bits = set(field.bits())
        if max(bits) < 8 * length and not bits & taken:
            fields.append(field)
            taken |= bits
    number = can_id | EXTENDED if extended else can_id
    text = HEAD + f"BO_ {number} Message: {length} DRIVE\n"
    text += "".join(field.line() for field in fields) + "\n"
    text += FORMATS if fd else ""
    text += f'BA_ "VFrameFormat" BO_ {number} {EXTENDED_FD if extended else STANDARD_FD};\n' * fd
    for field in fields:
        if field.is_float:
            text += f"SIG_VALTYPE_ {number} {field.name} : {1 if field.length == 32 else 2};\n"
    return text, can_id, extended, fd
