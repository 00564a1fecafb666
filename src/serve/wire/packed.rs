//! Answers straight to msgpack, without a tree of JSON values in between: the same maps as JSON, a number that is none
//! (NaN) being nil there too.

use rmp::encode as put;
use serde::ser::{
    Error as _, Impossible, Serialize, SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant,
    SerializeTuple, SerializeTupleStruct, SerializeTupleVariant, Serializer,
};
use serde_json::Error;

/// Writes `value` as msgpack.
pub fn packed<T: Serialize + ?Sized>(out: &mut Vec<u8>, value: &T) -> Result<(), Error> {
    value.serialize(Packer { out })
}

struct Packer<'a> {
    out: &'a mut Vec<u8>,
}

/// A list or a map under way.
struct Parts<'a> {
    out: &'a mut Vec<u8>,
    /// Where its head stands, if what the head said was no more than a guess.
    head: Option<usize>,
    /// Items so far, of so many.
    items: u32,
    announced: u32,
}

// Writing to memory does not fail.
macro_rules! leaf {
    ($($name:ident($t:ty) = $write:ident as $as:ty;)*) => {
        $(fn $name(self, v: $t) -> Result<(), Error> {
            drop(put::$write(self.out, <$as>::from(v)));
            Ok(())
        })*
    };
}

impl<'a> Packer<'a> {
    fn parts(self, length: Option<usize>, map: bool) -> Result<Parts<'a>, Error> {
        let announced = u32::try_from(length.unwrap_or(0)).map_err(Error::custom)?;
        let head = length.is_none().then_some(self.out.len());
        match (head, map) {
            // The longest head, to be filled in.
            (Some(_), map) => self.out.extend_from_slice(&[if map { 0xdf } else { 0xdd }, 0, 0, 0, 0]),
            (None, true) => drop(put::write_map_len(self.out, announced)),
            (None, false) => drop(put::write_array_len(self.out, announced)),
        }
        Ok(Parts { out: self.out, head, items: 0, announced })
    }

    /// A map of one entry, whose value follows.
    fn under(self, name: &str) -> Packer<'a> {
        drop(put::write_map_len(self.out, 1));
        drop(put::write_str(self.out, name));
        self
    }
}

impl Parts<'_> {
    fn item<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Error> {
        self.items += 1;
        packed(self.out, value)
    }

    fn field<T: Serialize + ?Sized>(&mut self, name: &str, value: &T) -> Result<(), Error> {
        drop(put::write_str(self.out, name));
        self.item(value)
    }

    fn end(self) -> Result<(), Error> {
        match self.head {
            Some(at) => self.out[at + 1..at + 5].copy_from_slice(&self.items.to_be_bytes()),
            None if self.items != self.announced => return Err(Error::custom("a length that was not kept")),
            None => {}
        }
        Ok(())
    }
}

impl<'a> Serializer for Packer<'a> {
    type Ok = ();
    type Error = Error;
    type SerializeSeq = Parts<'a>;
    type SerializeTuple = Parts<'a>;
    type SerializeTupleStruct = Parts<'a>;
    type SerializeTupleVariant = Parts<'a>;
    type SerializeMap = Parts<'a>;
    type SerializeStruct = Parts<'a>;
    type SerializeStructVariant = Parts<'a>;

    leaf! {
        serialize_i8(i8) = write_sint as i64;
        serialize_i16(i16) = write_sint as i64;
        serialize_i32(i32) = write_sint as i64;
        serialize_i64(i64) = write_sint as i64;
        serialize_u8(u8) = write_uint as u64;
        serialize_u16(u16) = write_uint as u64;
        serialize_u32(u32) = write_uint as u64;
        serialize_u64(u64) = write_uint as u64;
    }

    fn serialize_bool(self, v: bool) -> Result<(), Error> {
        drop(put::write_bool(self.out, v));
        Ok(())
    }

    fn serialize_f32(self, v: f32) -> Result<(), Error> {
        self.serialize_f64(f64::from(v))
    }

    fn serialize_f64(self, v: f64) -> Result<(), Error> {
        if !v.is_finite() {
            return self.serialize_unit();
        }
        drop(put::write_f64(self.out, v));
        Ok(())
    }

    fn serialize_char(self, v: char) -> Result<(), Error> {
        self.serialize_str(v.encode_utf8(&mut [0; 4]))
    }

    fn serialize_str(self, v: &str) -> Result<(), Error> {
        drop(put::write_str(self.out, v));
        Ok(())
    }

    fn serialize_bytes(self, v: &[u8]) -> Result<(), Error> {
        self.collect_seq(v)
    }

    fn serialize_none(self) -> Result<(), Error> {
        self.serialize_unit()
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Error> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), Error> {
        drop(put::write_nil(self.out));
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<(), Error> {
        self.serialize_unit()
    }

    fn serialize_unit_variant(self, _: &'static str, _: u32, name: &'static str) -> Result<(), Error> {
        self.serialize_str(name)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), Error> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        value: &T,
    ) -> Result<(), Error> {
        value.serialize(self.under(name))
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Parts<'a>, Error> {
        self.parts(length, false)
    }

    fn serialize_tuple(self, length: usize) -> Result<Parts<'a>, Error> {
        self.parts(Some(length), false)
    }

    fn serialize_tuple_struct(self, _: &'static str, length: usize) -> Result<Parts<'a>, Error> {
        self.parts(Some(length), false)
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        length: usize,
    ) -> Result<Parts<'a>, Error> {
        self.under(name).parts(Some(length), false)
    }

    fn serialize_map(self, length: Option<usize>) -> Result<Parts<'a>, Error> {
        self.parts(length, true)
    }

    fn serialize_struct(self, _: &'static str, length: usize) -> Result<Parts<'a>, Error> {
        self.parts(Some(length), true)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        length: usize,
    ) -> Result<Parts<'a>, Error> {
        self.under(name).parts(Some(length), true)
    }
}

macro_rules! lists {
    ($($of:ident::$add:ident),*) => {
        $(impl $of for Parts<'_> {
            type Ok = ();
            type Error = Error;

            fn $add<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Error> {
                self.item(value)
            }

            fn end(self) -> Result<(), Error> {
                Parts::end(self)
            }
        })*
    };
}
lists!(
    SerializeSeq::serialize_element,
    SerializeTuple::serialize_element,
    SerializeTupleStruct::serialize_field,
    SerializeTupleVariant::serialize_field
);

macro_rules! structs {
    ($($of:ident),*) => {
        $(impl $of for Parts<'_> {
            type Ok = ();
            type Error = Error;

            fn serialize_field<T: Serialize + ?Sized>(&mut self, name: &'static str, value: &T) -> Result<(), Error> {
                self.field(name, value)
            }

            fn end(self) -> Result<(), Error> {
                Parts::end(self)
            }
        })*
    };
}
structs!(SerializeStruct, SerializeStructVariant);

impl SerializeMap for Parts<'_> {
    type Ok = ();
    type Error = Error;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Error> {
        key.serialize(Key { out: self.out })
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Error> {
        self.item(value)
    }

    fn end(self) -> Result<(), Error> {
        Parts::end(self)
    }
}

/// A key, which is text.
struct Key<'a> {
    out: &'a mut Vec<u8>,
}

macro_rules! no_keys {
    ($($name:ident($t:ty)),*) => {
        $(fn $name(self, _: $t) -> Result<(), Error> {
            Err(no_key())
        })*
    };
}

macro_rules! numbers {
    ($($name:ident($t:ty)),*) => {
        $(fn $name(self, v: $t) -> Result<(), Error> {
            self.serialize_str(&v.to_string())
        })*
    };
}

impl Serializer for Key<'_> {
    type Ok = ();
    type Error = Error;
    type SerializeSeq = Impossible<(), Error>;
    type SerializeTuple = Impossible<(), Error>;
    type SerializeTupleStruct = Impossible<(), Error>;
    type SerializeTupleVariant = Impossible<(), Error>;
    type SerializeMap = Impossible<(), Error>;
    type SerializeStruct = Impossible<(), Error>;
    type SerializeStructVariant = Impossible<(), Error>;

    no_keys!(serialize_bool(bool), serialize_f32(f32), serialize_f64(f64), serialize_bytes(&[u8]));
    numbers!(
        serialize_i8(i8),
        serialize_i16(i16),
        serialize_i32(i32),
        serialize_i64(i64),
        serialize_u8(u8),
        serialize_u16(u16),
        serialize_u32(u32),
        serialize_u64(u64),
        serialize_char(char)
    );

    fn serialize_str(self, v: &str) -> Result<(), Error> {
        drop(put::write_str(self.out, v));
        Ok(())
    }

    fn serialize_none(self) -> Result<(), Error> {
        Err(no_key())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, _: &T) -> Result<(), Error> {
        Err(no_key())
    }

    fn serialize_unit(self) -> Result<(), Error> {
        Err(no_key())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<(), Error> {
        Err(no_key())
    }

    fn serialize_unit_variant(self, _: &'static str, _: u32, name: &'static str) -> Result<(), Error> {
        self.serialize_str(name)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), Error> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<(), Error> {
        Err(no_key())
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Self::SerializeSeq, Error> {
        Err(no_key())
    }

    fn serialize_tuple(self, _: usize) -> Result<Self::SerializeTuple, Error> {
        Err(no_key())
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self::SerializeTupleStruct, Error> {
        Err(no_key())
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeTupleVariant, Error> {
        Err(no_key())
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap, Error> {
        Err(no_key())
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self::SerializeStruct, Error> {
        Err(no_key())
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeStructVariant, Error> {
        Err(no_key())
    }
}

fn no_key() -> Error {
    Error::custom("a key that is no text")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Serialize;
    use serde_json::{Value, json};

    use super::*;
    use crate::serve::wire::pack::unpack;

    #[derive(Serialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Plain,
        Of(u8),
        Pair(i8, f64),
        With { x: f32, y: Option<()> },
    }

    #[derive(Serialize)]
    struct Inner {
        a: i64,
        #[serde(skip_serializing_if = "Option::is_none")]
        left_out: Option<u8>,
    }

    #[derive(Serialize)]
    struct Whole<'a> {
        #[serde(flatten)]
        inner: Inner,
        kinds: Vec<Kind>,
        text: &'a str,
        letter: char,
        none: Option<u8>,
        numbered: BTreeMap<u16, [u64; 2]>,
        floats: Vec<f64>,
        rest: Value,
    }

    #[test]
    fn what_json_says_is_what_msgpack_says() {
        let whole = Whole {
            inner: Inner { a: i64::MIN, left_out: None },
            kinds: vec![Kind::Plain, Kind::Of(200), Kind::Pair(-1, 0.1), Kind::With { x: 0.5, y: None }],
            text: &"ä".repeat(300),
            letter: 'ß',
            none: None,
            numbered: (0..20).map(|i| (i, [u64::from(i), u64::MAX])).collect(),
            floats: vec![f64::NAN, f64::INFINITY, -0.0, 1e300, f64::MIN_POSITIVE],
            rest: json!({"deep": [[{}, [], null, true, "", -129, 65536]], "0": 1.5}),
        };
        let mut bytes = Vec::new();
        packed(&mut bytes, &whole).unwrap();
        assert_eq!(unpack(&bytes).unwrap(), serde_json::to_value(&whole).unwrap());
        let mut bytes = Vec::new();
        packed(&mut bytes, &vec![0u32; 70_000]).unwrap();
        assert_eq!(unpack(&bytes).unwrap().as_array().map(Vec::len), Some(70_000));
        assert!(packed(&mut bytes, &BTreeMap::from([((1, 2), 3)])).is_err(), "no text");
    }
}
