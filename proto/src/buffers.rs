//! How messages become bytes: prost's encoding, in buffers that begin small.

use std::marker::PhantomData;

use prost::Message;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, EncodeBuf, Encoder};
use tonic_prost::{ProstCodec, ProstDecoder, ProstEncoder};

/// Bytes that a stream sets aside in each direction for as long as it is open. By default it is 8 KiB: of ten thousand
/// sessions that say a few hundred bytes now and then, 160 MB.
const FIRST_BYTES: usize = 512;

/// Bytes that are gathered before they are handed on: tonic's default.
const GATHERED_BYTES: usize = 32 << 10;

/// The codec of all services.
#[derive(Debug)]
pub struct Frugal<T, U>(PhantomData<(T, U)>);

/// Makes room for a message at once, which a buffer that begins small would do step by step.
#[derive(Debug)]
pub struct Fitting<T>(ProstEncoder<T>);

impl<T, U> Default for Frugal<T, U> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<T, U> Codec for Frugal<T, U>
where
    T: Message + Send + 'static,
    U: Message + Default + Send + 'static,
{
    type Encode = T;
    type Decode = U;
    type Encoder = Fitting<T>;
    type Decoder = ProstDecoder<U>;

    fn encoder(&mut self) -> Self::Encoder {
        Fitting(ProstEncoder::new(settings()))
    }

    fn decoder(&mut self) -> Self::Decoder {
        ProstCodec::<T, U>::raw_decoder(settings())
    }
}

impl<T: Message> Encoder for Fitting<T> {
    type Item = T;
    type Error = Status;

    fn encode(&mut self, item: T, buffer: &mut EncodeBuf<'_>) -> Result<(), Status> {
        buffer.reserve(item.encoded_len());
        self.0.encode(item, buffer)
    }

    fn buffer_settings(&self) -> BufferSettings {
        self.0.buffer_settings()
    }
}

fn settings() -> BufferSettings {
    BufferSettings::new(FIRST_BYTES, GATHERED_BYTES)
}
