//! The gRPC codec: prost's encoding with small initial buffers.

use std::marker::PhantomData;

use prost::Message;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, EncodeBuf, Encoder};
use tonic_prost::{ProstCodec, ProstDecoder, ProstEncoder};

/// Initial buffer of a stream in each direction, bytes. The default is 8 KiB: 160 MB for ten thousand sessions that
/// rarely send a few hundred bytes.
const FIRST_BYTES: usize = 512;

/// Bytes that are gathered before they are sent: tonic's default.
const GATHERED_BYTES: usize = 32 << 10;

/// The codec of all services.
#[derive(Debug)]
pub struct Frugal<T, U>(PhantomData<(T, U)>);

/// An encoder that reserves a message's size at once, instead of growing the small buffer in steps.
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
